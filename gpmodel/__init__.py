"""Find what the model of a mechanism is missing: name it, add it, prove it on poses never seen."""

__version__ = "0.1.0"
