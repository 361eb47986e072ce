"""Genetic programming with linear sequences and trees, independent of robots."""
