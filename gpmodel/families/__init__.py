"""The catalogue of physical causes: candidate effects for a mechanism and the columns of its table."""
