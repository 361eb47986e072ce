"""Check a measured table before calibration, and assign the columns of files of other programs."""
