"""Loaders that convert the description of a robot arm to a Mechanism."""

from robots.library import load_mechanism, mechanism_names

__all__ = ["load_mechanism", "mechanism_names"]
