"""The linear problem at one point, ready to be solved for the residual there and for what a step has missed."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.priors import ReadJoints, beliefs, noise_sigma
from gpmodel.model.error_model import ErrorModel, Placement
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import solve


@dataclass(frozen=True)
class LinearStep:
    """Least squares over the columns of `free` (K,) that are left, scaled to unit length, and the rows of the priors.

    priors: (B, F) rows beneath the scaled columns. pulls: (B,), their right side. readings: what of approximate joint
    values is among them. factor: of the normal equations, where the columns are many. geometry: (G, E) rows of the
    description on the unknowns.
    """

    problem: Linearised
    free: Mask
    scale: Array
    priors: Array
    pulls: Array
    readings: ReadJoints
    factor: tuple[Array, bool] | None
    geometry: Array

    def solved(self, residual: Array, pulls: Array) -> tuple[Array, float]:
        """The whole step (K,) for a residual (M,), zero for what is not free; and what it takes off the cost, m²."""
        step = np.zeros(len(self.free))
        if self.factor is None:
            system = np.vstack([self.problem.columns[:, self.free] / self.scale, self.priors])
            right = np.concatenate([residual, pulls])
            scaled = solve(system, right)
            fall = float((system @ scaled) @ right)
        else:
            right = (self.problem.columns.T @ residual)[self.free] / self.scale + self.priors.T @ pulls
            scaled = linalg.cho_solve(self.factor, right, check_finite=False)
            fall = float(scaled @ right)
        step[self.free] = scaled / self.scale
        return step, fall


def linear_step(
    model: ErrorModel, problem: Linearised, theta: Array, placement: Placement, kept: Mask, gram: Array | None
) -> LinearStep:
    """The linear problem over the placement and the `kept` effects (E,).

    gram: products (K, K) of the columns where these are so many that the normal equations are solved.
    """
    free = problem.free(kept)
    belief = beliefs(model, problem, theta, placement, kept)
    rows = belief.rows[:, free]
    readings = ReadJoints.beside(problem, rows, free, noise_sigma(model, problem))
    rows = np.vstack([rows, readings.rows(problem)[:, free]])
    scale = np.hypot(problem.sizes[free], np.linalg.norm(rows, axis=0))
    scale[scale < ident.NEGLIGIBLE] = np.inf
    rows /= scale
    factor = None
    if gram is not None:
        inner = gram[np.ix_(free, free)] / np.outer(scale, scale)
        inner[np.diag_indices_from(inner)] += np.sum(rows[: belief.single] ** 2, axis=0)
        inner += rows[belief.single :].T @ rows[belief.single :]
        factor = ident.factored(inner)
    pulls = np.concatenate([belief.pulls, readings.pull(problem)])
    return LinearStep(problem, free, scale, rows, pulls, readings, factor, belief.geometry)
