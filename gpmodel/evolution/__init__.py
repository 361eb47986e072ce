"""Genetic programming with linear instruction sequences and trees, for any residual."""
