"""Find what the model of a mechanism is missing: name it, add it, prove it on poses never seen."""

from gpmodel._version import __version__

__all__ = ["__version__"]
