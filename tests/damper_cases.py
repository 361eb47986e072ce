"""Textbook formulas of a spring, mass and damper, compared with the general code."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class SpringMassDamper:
    """m x'' + c x' + k x = F: mass [kg], damping [N s/m], stiffness [N/m]."""

    mass: float
    damping: float
    stiffness: float

    @property
    def damping_ratio(self) -> float:
        return float(self.damping / (2 * np.sqrt(self.stiffness * self.mass)))

    def dynamic_stiffness(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        omega = 2 * np.pi * np.asarray(frequency, float)
        return self.stiffness - self.mass * omega**2 + 1j * omega * self.damping
