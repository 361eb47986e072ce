"""Interfaces of a mechanism, and the loading of mechanisms by name."""
