"""Measured tables: reading, units, held-out poses and folds, writing."""
