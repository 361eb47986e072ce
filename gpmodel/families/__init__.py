"""The catalogue of physical causes of robot errors, as candidate effects for a mechanism and its measured table."""
