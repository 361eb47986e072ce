"""Measured tables of poses: reading, units, held-out poses, cross-validation folds, writing."""
