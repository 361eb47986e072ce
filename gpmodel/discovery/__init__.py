"""Run the search for missing effects: from the residual of a calibration to named and tested effects."""
