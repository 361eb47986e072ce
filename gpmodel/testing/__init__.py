"""Contract checks of extensions: a mechanism, a family of effects, a representation of programs.

Contract checks are plain functions for an author's tests. A check raises AssertionError with the violated condition.
"""

from gpmodel.testing.effects import check_effect, check_family
from gpmodel.testing.mechanisms import check_mechanism, check_representation

__all__ = ["check_effect", "check_family", "check_mechanism", "check_representation"]
