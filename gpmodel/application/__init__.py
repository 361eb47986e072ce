"""What a finished model is for: files, prediction, compensation."""
