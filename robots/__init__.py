"""Robots: loaders that turn a description of an arm into a mechanism."""

from robots.library import load_mechanism, mechanism_names

__all__ = ["load_mechanism", "mechanism_names"]
