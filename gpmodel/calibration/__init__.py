"""Fit registration, tool point, geometric constants and effects together."""
