"""Contract checks for what others bring: a mechanism, a family of effects, a representation of programs.

Each is a plain function for one's own test suite; it raises AssertionError that says what does not hold.
"""

from gpmodel.testing.effects import check_effect, check_family
from gpmodel.testing.mechanisms import check_mechanism, check_representation

__all__ = ["check_effect", "check_family", "check_mechanism", "check_representation"]
