"""Robots: loaders that convert the description of an arm to a mechanism."""

from robots.library import load_mechanism, mechanism_names

__all__ = ["load_mechanism", "mechanism_names"]
