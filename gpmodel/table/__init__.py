"""Measured tables: reading, units, splits, writing."""
