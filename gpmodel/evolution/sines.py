"""A smooth function of one input as a sum of sines, whose coefficients have the deviations of a Gaussian process.

A function φ with the covariance exp(-(u - v)² / 2l²), u scaled to [-1, 1] over the poses, is a sum of sines over a
wider interval [-c, c] whose coefficients have deviations that fall as the spectrum of the covariance:

    φ_j(u) = sin(ω_j (u + c)),    ω_j = π j / 2c,    spread_j = exp(-l² ω_j² / 4)

Source: Solin and Särkkä (2020), Hilbert-space Gaussian processes; Riutort-Mayol et al. (2023) for c = max(1.5, 3.2 l)
and 1.75 c / l sines.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sines:
    """The sines of one input. values: (N, m) times their deviations. rates: rad per unit; start: where they are 0."""

    name: str
    values: Array
    rates: Array
    start: float
    spreads: Array

    @staticmethod
    def of(name: str, column: Array, length: float) -> "Sines":
        """The sines of a column (N,) for a correlation length over half its range."""
        half, reach = 0.5 * float(np.ptp(column)), max(1.5, 3.2 * length)
        omega = np.pi * np.arange(1, math.ceil(1.75 * reach / length) + 1) / (2.0 * reach)
        start = float(column.min()) - (reach - 1.0) * half
        spreads = np.exp(-((length * omega) ** 2) / 4.0)
        rates = np.array([float(f"{w / half:.6g}") for w in omega])
        start = float(f"{start:.12g}")  # clocks count from far away
        return Sines(name, np.sin(np.outer(column - start, rates)) * spreads, rates, start, spreads)

    def text(self, k: int) -> str:
        """Sine k as an expression."""
        return f"sin({float(self.rates[k])!r}*({self.name} - ({self.start!r})))"
