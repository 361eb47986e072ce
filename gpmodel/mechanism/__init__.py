"""Interfaces of a mechanism, and the providers that load one by name."""
