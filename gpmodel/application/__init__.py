"""Uses of a finished model: files, prediction, compensation."""
