"""The catalogue of physical causes, which offers candidate effects for a mechanism and a table."""
