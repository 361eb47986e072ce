"""Evidence of the measurements for an effect: residuals, scores, null, tests, limits."""
