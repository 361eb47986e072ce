"""Check a measured table before any fit, and assign the columns of files of other programs."""
