"""Linear algebra, rigid motions, confidence intervals and p-values."""
