"""Variance components of a linear model: standard deviations of groups of random coefficients, and of the noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.arrays import Array, IntArray

STEPS, SETTLED = 100, 1e-3
"""Largest number of iterations of the variances, and relative change of the noise variance at which they end."""


@dataclass(frozen=True)
class Fixed:
    """Estimate of a fixed coefficient.

    chance: probability of an estimate at least so far from zero if the coefficient is zero.
    deviations: standard deviations of the groups and of the noise, given the coefficient.
    """

    value: float
    stderr: float
    chance: float
    deviations: Array


@dataclass(frozen=True)
class Mixed:
    """Linear model with random coefficients in groups (mixed model).

        y = Σ_k C_k κ_k + e,   κ_k ~ N(0, τ_k² I),   e ~ N(0, σ² I)

    columns: columns C of all groups, (values, coefficients). group: group of each coefficient. values: y.
    count: number of values, less the number of coefficients that were projected out of columns and values.
    usual: usual standard deviation of the coefficients of each group; the last one is that of the noise.
    """

    columns: Array
    group: IntArray
    values: Array
    count: int
    usual: Array

    @classmethod
    def of(cls, groups: Sequence[Array], usual: Sequence[float], values: Array, count: int) -> "Mixed":
        """Return the model with groups of columns (values, coefficients)."""
        group = np.repeat(np.arange(len(groups)), [part.shape[1] for part in groups])
        return cls(np.hstack([*groups]), group, values, count, np.array(usual, dtype=float))

    def given(self, column: Array) -> "Mixed":
        """Return the model of the values orthogonal to a column, whose coefficient is fixed."""
        unit = column / np.linalg.norm(column)
        columns, values = self.columns - np.outer(unit, unit @ self.columns), self.values - unit * (unit @ self.values)
        return Mixed(columns, self.group, values, self.count - 1, self.usual)

    def deviations(self) -> tuple[Array, Array]:
        """Estimate the standard deviations τ_k of the groups and σ of the noise, and their degrees of freedom.

        Restricted maximum likelihood with a scaled inverse χ² prior that weighs as much as one coefficient of the usual
        size u_k. With γ_k the number of coefficients of group k that the values determine, the fixed point is
        τ_k² = (|κ_k|² + u_k²) / (γ_k + 1) and σ² = (|e|² + u²) / (count - Σ γ_k + 1).
        Source: MacKay (1992), Bayesian Interpolation.
        """
        gram, pull = self.columns.T @ self.columns, self.columns.T @ self.values
        squares, usual = float(self.values @ self.values), self.usual**2
        sizes, variances = np.bincount(self.group), usual.copy()
        variances[-1] = squares / self.count
        for _ in range(STEPS):
            scale = np.sqrt(variances[self.group] / variances[-1])
            inverse = np.linalg.inv(np.eye(len(scale)) + scale[:, None] * gram * scale)
            found = scale * (inverse @ (scale * pull))
            known = sizes - np.bincount(self.group, np.diag(inverse))
            left = max(squares - found @ (2 * pull - gram @ found), 0.0)
            freedom = np.append(known, max(self.count - known.sum(), 0.0)) + 1.0
            before, variances = variances, (np.append(np.bincount(self.group, found**2), left) + usual) / freedom
            if np.abs(variances / before - 1.0).max() < SETTLED:
                break
        return np.sqrt(variances), freedom

    def fixed(self, column: Array) -> Fixed:
        """Estimate the coefficient of a column by generalised least squares, with the variances estimated given it.

        With the weights w = V⁻¹ c / (cᵀ V⁻¹ c) of the values and V = Σ τ_k² C_k C_kᵀ + σ² I, the estimate wᵀ y has the
        variance Σ τ_k² |C_kᵀ w|² + σ² |w|². Its degrees of freedom are by Welch and Satterthwaite (JCGM 100, G.4).
        """
        tau, freedom = self.given(column).deviations()
        scaled = self.columns * (tau[self.group] / tau[-1])
        inner = np.linalg.solve(np.eye(scaled.shape[1]) + scaled.T @ scaled, scaled.T @ column)
        weights = column - scaled @ inner
        weights /= weights @ column
        parts = tau**2 * np.append(np.bincount(self.group, (weights @ self.columns) ** 2), weights @ weights)
        value, variance = float(weights @ self.values), float(parts.sum())
        stderr = float(np.sqrt(variance))
        chance = 2 * special.stdtr(variance**2 / np.sum(parts**2 / freedom), -abs(value) / stderr)
        return Fixed(value, stderr, float(chance), tau)
