"""Genetic programming: linear sequences and trees, on its own."""
