"""Evidence of the measurements for an effect: residuals, scores, permutation nulls, tests, limits."""
