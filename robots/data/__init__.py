"""Example descriptions of robots."""
