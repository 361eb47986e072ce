"""Export of a fitted model to file formats of other programs."""
