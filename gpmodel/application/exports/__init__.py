"""A fitted model in the forms that others read."""
