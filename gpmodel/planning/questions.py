"""What poses are chosen for, and how what they tell is said."""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.planning.design import Question


@dataclass(frozen=True)
class Asked:
    """said: in words. choose: what decides; none to spread them, away from those `taken` (M, n). measure: questions of
    variances whose worst is what the curve shows, as `label`: times `factor`, or its inverse where that is larger the
    better."""

    said: str
    choose: tuple[Question, ...]
    measure: tuple[Question, ...]
    label: str
    factor: float = 1.0
    inverse: bool = False
    taken: Array | None = None

    def said_of(self, deviation: Array) -> Array:
        """Standard deviations (n,) as the curve shows them."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / deviation if self.inverse else self.factor * deviation)
