"""Text, pages and pictures of saved calibration results."""
