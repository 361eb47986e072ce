"""Run the discovery loop: from the residual of a calibration to named and tested effects."""
