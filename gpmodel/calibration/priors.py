"""Prior distributions of calibrated parameters, as additional rows of the least-squares problem."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.overall_scale import (
    TOLERANCE,
    equivalent_changes,
    nominal_constants,
    scale_unobservable,
    spread,
    without_positions,
)
from gpmodel.model.error_model import ErrorModel, Placement
from gpmodel.numerics import rank as ident

TOOL_REACH = 1.0
"""Prior standard deviation of a tool point, m from the flange. The prior of a tool point matters only if the poses do
not determine the tool point."""

GEOMETRY_REACH = 0.01
"""Prior standard deviation of a geometric constant about its nominal value, m or rad. The prior matters only if the
poses hardly determine the constant, as with hundreds of harmonics in the model."""


def prior_rows(model: ErrorModel, theta: Array, problem: Linearised, kept: Mask) -> tuple[Array, Array]:
    """Return left and right side of the priors (θ - mean) σ / prior = 0 of the fitted effects θ; σ is the noise."""
    prior = np.array([e.prior for e in model.effects])
    at = np.flatnonzero(kept & np.isfinite(prior))
    sigma = noise_sigma(model, problem)
    return _one_each(problem, at, sigma / prior[at]), -off_mean(model, theta)[at] * sigma / prior[at]


def _one_each(problem: Linearised, effects: IntArray, weights: Array) -> Array:
    """Return one row per effect index in `effects`, zero except for the effect's weight in the effect's column."""
    rows = np.zeros((len(effects), problem.columns.shape[1]))
    rows[np.arange(len(effects)), problem.placement + effects] = weights
    return rows


def off_mean(model: ErrorModel, theta: Array) -> Array:
    """Return the values of the effects minus their prior means."""
    return theta - np.array([e.mean for e in model.effects], np.float64)


def geometry_rows(model: ErrorModel, theta: Array, problem: Linearised, placement: Placement, at: IntArray) -> Array:
    """Return the equations of the priors, m, of the fitted geometric constants with the indices `at`.

    If a measurement is in an instrument's frame, a constant has the standard deviation 10 mm or 10 mrad. Without a
    frame, all constants θ_all, fitted or not, have the standard deviation `reach`. The fitted constants θ = A
    θ_all have the prior covariance reach² A Aᵀ, and the fit nearest to the nominal geometry does not depend on which
    constants are fitted. The standard deviation `reach` is estimated, up to the limit TOLERANCE.
    """
    if not (len(at) and without_positions(problem)):
        return np.diag(np.full(len(at), residual_sigma(problem) / GEOMETRY_REACH))
    inverse, explained = _explained(model, theta, problem, placement, at)
    if problem.ratio is not None:
        return inverse * problem.ratio
    believed, sigma, _ = spread(*explained, TOLERANCE)
    return inverse * sigma / believed


def _explained(
    model: ErrorModel, theta: Array, problem: Linearised, placement: Placement, at: IntArray
) -> tuple[Array, tuple[Array, Array, Array]]:
    """Return L⁻¹ with A Aᵀ = L Lᵀ, where A maps all constants to fitted constants, and three arguments of `spread`.

    Arguments of `spread` are columns of the fitted constants in units of their prior, measurements, and columns of
    registration and tool.
    """
    others = np.setdiff1d(np.flatnonzero(nominal_constants(model)), at)
    stands, growth = equivalent_changes(model, problem, placement, at, others)
    parts = np.hstack([np.eye(len(at)), stands])
    lower = np.linalg.cholesky(parts @ parts.T)
    inverse = np.linalg.inv(lower)
    placed, columns = problem.columns[:, : problem.placement], problem.columns[:, problem.placement + at]
    shown = columns @ lower
    if scale_unobservable(problem):  # a machine shrunk to a point would explain any residual
        shown = ident.remove(ident.orthonormal((inverse @ growth)[:, None]), shown.T).T
    return inverse, (shown, problem.residual + columns @ theta[at], placed)


def tool_rows(problem: Linearised, placement: Placement) -> tuple[Array, Array]:
    """Return left and right side of the prior p σ / TOOL_REACH = 0 of every tool point p, m, with σ the noise, m.

    Without a prior, the tool point of a table with few moving joints can drift by kilometres without changing the
    fit. The prior rows of tool points are in the axes of the tool.
    """
    rows = np.zeros((3 * len(placement.tool), problem.columns.shape[1]))
    pull = np.zeros(len(rows))
    weight = residual_sigma(problem) / TOOL_REACH
    for i, (name, frame) in enumerate(placement.tool.items()):
        first = problem.placement_names.index(f"tool{f' {name}' if name else ''} Tx")
        rows[3 * i : 3 * i + 3, first : first + 3] = weight * frame[:3, :3]
        pull[3 * i : 3 * i + 3] = -weight * frame[:3, 3]
    return rows, pull


@dataclass(frozen=True)
class Priors:
    """Left and right sides of the linear equations of all priors of a fit.

    effect_rows: number of leading rows that are priors of effects.
    single: number of leading rows with one effect per row.
    geometry: prior equations of the geometric constants, in terms of all effects.
    """

    rows: Array
    rhs: Array
    effect_rows: int
    single: int
    geometry: Array


def fit_priors(model: ErrorModel, problem: Linearised, theta: Array, placement: Placement, kept: Mask) -> Priors:
    """Return the priors of the effects of the mask `kept`, linearised at effects `theta` and at `placement`."""
    at = np.flatnonzero(kept & nominal_constants(model))
    geometry = np.zeros((len(at), len(model.effects)))
    geometry[:, at] = geometry_rows(model, theta, problem, placement, at)
    on_all = np.hstack([np.zeros((len(geometry), problem.placement)), geometry])
    pulls = -geometry @ theta
    (prior, prior_pull), (tool, tool_pull) = prior_rows(model, theta, problem, kept), tool_rows(problem, placement)
    rows, pulls = np.vstack([prior, on_all, tool]), np.concatenate([prior_pull, pulls, tool_pull])
    return Priors(rows, pulls, len(prior), len(prior) + (0 if without_positions(problem) else len(at)), geometry)


@dataclass(frozen=True)
class JointPriors:
    """Prior rows (q_table - q) σ / τ = 0 of approximate joint values q: noise σ, m, and error τ of the joint values.

    combinations: combinations of joint values that the measurements determine less well.
    weight: weight σ / τ of a row, m, with noise σ and error τ of the joint values.
    """

    combinations: Array
    weight: float

    @classmethod
    def select(cls, problem: Linearised, rows: Array, free: Mask, sigma: float) -> "JointPriors":
        """Select combinations of approximate joint values that determine an unknown better than the measurements do
        together with the prior rows `rows`.

        free: mask of the fitted columns. sigma: noise of measurements, m. If every joint is measured, no prior row is
        returned.
        """
        if problem.reduced is None:
            return cls(np.zeros((0, 0)), 0.0)
        known = replace(problem.reduced.readings, rows=problem.reduced.readings.rows[:, free])
        alone = known.informative(np.vstack([problem.columns[:, free], rows]), sigma)
        return cls(alone, sigma / known.error(alone.shape[1]))

    def rows(self, problem: Linearised) -> Array:
        """Return the prior rows of the approximate joint values, m, one per selected combination."""
        if problem.reduced is None:
            return np.zeros((0, problem.columns.shape[1]))
        return self.weight * self.combinations.T @ problem.reduced.readings.rows

    def rhs(self, problem: Linearised) -> Array:
        """Return the right side of the prior rows of the approximate joint values, m."""
        left = problem.reduced
        return np.zeros(0) if left is None else self.weight * self.combinations.T @ left.readings.off


def noise_sigma(model: ErrorModel, problem: Linearised) -> float:
    """Return the noise σ of one component, m, that scales the priors: the model's noise, else the RMS residual."""
    return residual_sigma(problem) if model.noise is None else model.noise


def residual_sigma(problem: Linearised) -> float:
    """Return the RMS of the weighted residual, m, per measured component."""
    return float(np.sqrt(np.mean(problem.residual**2)))
