"""Robots: loaders that turn a description of an arm into a mechanism."""
