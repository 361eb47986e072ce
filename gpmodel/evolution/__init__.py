"""Genetic programming with linear instruction sequences and trees, independent of robots."""
