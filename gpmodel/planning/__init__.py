"""Poses worth measuring, and tables with known truth."""
