"""Fitting registration, tool, geometry and effects together."""
