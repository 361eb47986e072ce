"""Columns of the poses, error effects, and the error model of a mechanism with its measurements."""
