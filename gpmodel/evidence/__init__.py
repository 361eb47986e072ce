"""What the measurements say of an effect: residuals, scores, null, tests, limits."""
