"""Check a measured table before it is used, and assign the columns of foreign files."""
