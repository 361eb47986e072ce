"""Compute residuals, scores, permutation nulls and tests that measure the evidence for an effect."""
