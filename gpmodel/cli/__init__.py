"""Command line: thin wrappers of the functions of `gpmodel.api`."""
