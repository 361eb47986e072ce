"""The residual of a calibration: what was measured less all that the model explains, and columns seen the same way."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.priors import prior_rows
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.units import independent_units
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import factored
from gpmodel.numerics.outliers import outlier_limit
from gpmodel.table.split import folds

LARGEST = 1e100
"""A column of larger numbers is not scored: their squares would not be numbers."""


@dataclass(frozen=True)
class Residual:
    """The training residual of a calibration with everything the model already explains projected out.

    Effects with priors are rows too, θ σ / prior = 0, below the M measured ones: what they explain is taken out as
    far as their priors let them, no further. enabled: (M + B, K) orthonormal columns of the model. values: (M + B,).
    system, target: the columns (M + B, K') and right side these came from. fold_of_row: (M,).
    unit_of_pose: (N,) which poses count as one observation. shrink: (N,) factor by which far-out residuals are shorter.
    criteria: the limits everything about it is held to.
    """

    calibration: Calibration
    poses: Poses
    problem: Linearised
    system: Array
    target: Array
    enabled: Array
    values: Array
    fold_of_row: IntArray
    unit_of_pose: IntArray
    shrink: Array
    criteria: Criteria

    @property
    def winsorised(self) -> Mask:
        """The poses (N,) whose residual was shortened."""
        return np.asarray(self.shrink < 1.0)

    @property
    def measured(self) -> int:
        """M, rows that were measured."""
        return len(self.fold_of_row)

    @property
    def energy(self) -> float:
        """Sum of squares r·r of the weighted residual."""
        return float(self.values @ self.values)

    @property
    def freedom(self) -> int:
        """Degrees of freedom: residuals less the columns that were fitted to them, at least 1."""
        return max(len(self.values) - self.enabled.shape[1], 1)

    @cached_property
    def rms(self) -> float:
        """3-D RMS of the residual, m."""
        return float(np.linalg.norm(self.values[: self.measured]) / np.sqrt(len(np.unique(self.problem.pose_of_row))))

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Weighted columns (M, E) of any effects at these poses."""
        blocks = effect_columns(tuple(effects), self.calibration.model, self.poses, self.problem.observed)
        return self.problem.weigh(blocks)

    def projected(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Columns (M + B, E) less what is enabled, and the share (E,) of each left; zero where past numbers."""
        with np.errstate(all="ignore"):
            columns = self.columns(effects)
        columns[:, ~(np.abs(columns) < LARGEST).all(axis=0)] = 0.0
        norms = np.linalg.norm(columns, axis=0)
        alive = norms > ident.NEGLIGIBLE * 1e-3
        padded = np.zeros((len(self.values), len(norms)))
        padded[: self.measured] = columns / np.where(alive, norms, 1.0)
        left = ident.remove(self.enabled, padded) * alive
        return left, np.linalg.norm(left, axis=0)

    def poses_at_work(self, effects: Sequence[Effect]) -> Array:
        """At how many poses each effect (E,) says what nothing enabled says: (Σ e)² / Σ e², e its energy per pose.

        One where all of it sits at a single pose, N where all poses share alike.
        """
        left = self.projected(effects)[0][: self.measured] ** 2
        energy = np.zeros((len(self.poses), left.shape[1]))
        np.add.at(energy, self.problem.pose_of_row, left)
        return energy.sum(axis=0) ** 2 / np.maximum(np.sum(energy**2, axis=0), 1e-300)

    def without(self, effects: Sequence[Effect]) -> "Residual":
        """The same with the part of some of its model's effects given back, as if they were not in it."""
        system, target, enabled = _system(self.calibration, self.problem, self.shrink, effects)
        return replace(self, system=system, target=target, enabled=enabled, values=ident.remove(enabled, target))

    @cached_property
    def without_folds(self) -> tuple[tuple[Mask, tuple[Array, bool], Array], ...]:
        """Of every fold: its rows (M,), the factored normal equations of the system without them, their solution."""
        gram, pull = self.system.T @ self.system, self.system.T @ self.target
        out = []
        for fold in np.unique(self.fold_of_row):
            test = self.fold_of_row == fold
            part, right = self.system[: self.measured][test], self.target[: self.measured][test]
            factor = factored(gram - part.T @ part)
            out.append((test, factor, linalg.cho_solve(factor, pull - part.T @ right, check_finite=False)))
        return tuple(out)


def residual_of(
    calibration: Calibration, poses: Poses, criteria: Criteria, seed: int, trusted: Mask | None = None
) -> Residual:
    """The residual of a calibration at poses, every one of them; far-out poses are winsorised, not dropped.

    trusted: (N,) poses taken as they are. seed: of the folds.
    """
    problem = problem_at(calibration, poses)
    shrink = _shrunk(problem, len(poses), criteria.outlier_sigmas)
    if trusted is not None:
        shrink[trusted] = 1.0
    system, target, enabled = _system(calibration, problem, shrink, ())
    fold = folds(poses.dataset, criteria.folds, np.random.default_rng(seed))[problem.pose_of_row]
    return Residual(
        calibration, problem.poses, problem, system, target, enabled, ident.remove(enabled, target), fold,
        independent_units(poses.dataset, criteria), shrink, criteria,
    )  # fmt: skip


def _system(
    calibration: Calibration, problem: Linearised, shrink: Array, without: Sequence[Effect]
) -> tuple[Array, Array, Array]:
    """Columns and right side (M + B) of what is enabled but for some effects, and the orthonormal span of the columns.

    without: effects whose part is given back to the right side.
    """
    returned = np.isin([e.name for e in calibration.model.effects], [e.name for e in without])
    shortened = problem.residual * shrink[problem.pose_of_row]
    shortened = shortened + problem.columns[:, problem.placement :][:, returned] @ calibration.theta[returned]
    kept = calibration.kept & ~returned
    free = np.concatenate([np.ones(problem.placement, dtype=bool), kept])
    belief, pull = prior_rows(calibration.model, calibration.theta, problem, kept)
    system, target = np.vstack([problem.columns[:, free], belief[:, free]]), np.concatenate([shortened, pull])
    scale = np.linalg.norm(system, axis=0)
    system /= np.where(scale > 0, scale, 1.0)
    return system, target, _spanned(system, np.any(belief[:, free] != 0, axis=0))


def _shrunk(problem: Linearised, poses: int, sigmas: float) -> Array:
    """Factor (N,) that brings each pose's residual to at most median + sigmas · 1.4826 MAD of all lengths."""
    squared = np.zeros(poses)
    np.add.at(squared, problem.pose_of_row, problem.residual**2)
    length = np.sqrt(squared)
    return np.minimum(1.0, outlier_limit(length, sigmas) / np.maximum(length, 1e-12))


def _spanned(system: Array, with_prior: Mask) -> Array:
    """Orthonormal basis of unit columns (M + B, K): those without priors decided by rank, those with by Cholesky."""
    plain = ident.orthonormal(system[:, ~with_prior])
    if not with_prior.any():
        return plain
    rest = ident.remove(plain, system[:, with_prior])
    upper, _ = factored(rest.T @ rest)
    return np.hstack([plain, linalg.solve_triangular(upper, rest.T, trans="T", check_finite=False).T])
