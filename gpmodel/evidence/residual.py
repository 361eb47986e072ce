"""Form the residual of a calibration, project effects' columns like the residual, and permute blocks of poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import LARGEST, Array, IntArray, Mask
from gpmodel.calibration.gauge import nonzero_in_one_fold
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.overall_scale import without_positions
from gpmodel.calibration.priors import fit_priors
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.evidence.criteria import Criteria
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import Omitted, outlier_limit
from gpmodel.table.blocks import folds, repeat_blocks, replicates, stretches
from gpmodel.table.dataset import Dataset


def independent_blocks(dataset: Dataset, criteria: Criteria) -> IntArray:
    """Return the block index of each pose; the poses of a block count as one observation. Blocks are in order of rows.

    Poses with one value of `group` or `repeat` in the table form a block. If the blocks are too few for a permutation
    test, only rows that measure one pose form a block.
    """
    codes = repeat_blocks(dataset)
    if codes.max(initial=-1) + 1 < criteria.fewest_blocks:
        codes = replicates(dataset, whatever=bool(dataset.observations))
    _, first, of_pose = np.unique(codes, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[of_pose.reshape(-1)].astype(np.int64)


def exchangeable_blocks(dataset: Dataset, criteria: Criteria) -> IntArray:
    """Return the block index of each pose; a permutation moves the poses of a block together.

    Blocks are groups and repeats of the table. For single poses in the order of measurement, blocks are stretches of
    rows, which keep the dependence between neighbouring rows. Source: Künsch (1989), blocks.
    """
    unit = independent_blocks(dataset, criteria)
    count = len(dataset)
    if not dataset.in_order or unit.max(initial=-1) + 1 < count or count < 2 * criteria.fewest_blocks:
        return unit
    return stretches(dataset.row.astype(float), criteria.fewest_blocks)


STEPS, SETTLED = 30, 1.01
"""Largest number of iterations for the noise σ, and ratio of successive σ at which they end."""


@dataclass(frozen=True)
class Residual:
    """Training residual of a calibration with the columns of its model projected out.

    Each effect θ with a prior adds a row θ σ / prior = 0 below the measured rows, with σ the noise.
    system: columns of the model, scaled to unit length, on measured rows and prior rows.
    target: right side of the linear system, m.
    span: orthonormal basis of the columns of the model.
    values: residual on measured rows and prior rows, m.
    names: effects of the columns after the columns of registration and tool.
    fold_of_row: fold of each measured row in the cross-validation.
    block_of_pose: block index of each pose; the poses of a block count as one observation.
    gram: inner products of the columns; empty if no effect has a prior.
    scale_rows: number of prior rows on lengths and tool point, which fix the overall scale.
    noise: standard deviation σ that weights the priors, m.
    """

    calibration: Calibration
    poses: Poses
    problem: Linearised
    system: Array
    target: Array
    span: ident.Span
    values: Array
    names: tuple[str, ...]
    fold_of_row: IntArray
    block_of_pose: IntArray
    criteria: Criteria
    gram: Array
    scale_rows: int = 0
    noise: float = 0.0

    @property
    def measured(self) -> int:
        """Number of measured components of all poses (rows of the residual)."""
        return len(self.fold_of_row)

    @property
    def energy(self) -> float:
        """Sum of squares of the weighted residual, m²."""
        return float(self.values @ self.values)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residual: number of rows minus number of fitted columns, at least 1."""
        return max(len(self.values) - self.span.size - max(self.scale_rows - 1, 0), 1)

    @property
    def sigma(self) -> float:
        """Standard deviation of one weighted component of the residual, m."""
        return float(np.sqrt(self.energy / self.freedom))

    @cached_property
    def rms(self) -> float:
        """RMS over the poses of the 3-D length of the residual, m."""
        return float(np.linalg.norm(self.values[: self.measured]) / np.sqrt(len(np.unique(self.problem.pose_of_row))))

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Return the weighted derivatives of measured rows with respect to the coefficients of the given effects."""
        return self.problem.effect_rows(effects, self.calibration.model)

    def projected(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Return the columns of effects with the model projected out, and the share of each column that remains.

        A column with too large values (overflow) has the share zero.
        """
        asked = tuple(effects)
        found = self._projected.get(asked)
        if found is None:
            found = self._without_enabled(asked)
            self._projected.clear()
            self._projected[asked] = found
        return found

    @cached_property
    def _projected(self) -> dict[tuple[Effect, ...], tuple[Array, Array]]:
        """Cache of the last projected columns, which all tests of a candidate effect use."""
        return {}

    def _without_enabled(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        with np.errstate(all="ignore"):
            columns = self.columns(effects)
        columns[:, ~(np.abs(columns) < LARGEST).all(axis=0)] = 0.0
        norms = np.linalg.norm(columns, axis=0)
        alive = norms > ident.NEGLIGIBLE * 1e-3
        padded = np.zeros((len(self.values), len(norms)))
        padded[: self.measured] = columns / np.where(alive, norms, 1.0)
        left = self.span.remove(padded) * alive
        left.setflags(write=False)
        return left, np.linalg.norm(left, axis=0)

    def without(self, effects: Sequence[Effect]) -> "Residual":
        """Return the residual of the calibration's model without some of its effects."""
        given = [e.name for e in effects]
        kept = self.problem.free(~np.isin(self.names, given))
        with_prior = np.any(self.system[self.measured :] != 0, axis=0)
        rows = np.concatenate([np.ones(self.measured, dtype=bool), kept[with_prior]])
        model = self.calibration.model
        returned = np.isin([e.name for e in model.effects], given)
        back = self.problem.columns[:, self.problem.placement :][:, returned] @ self.calibration.theta[returned]
        target = self.target.copy()
        target[: self.measured] += back
        system = self.system[np.ix_(rows, kept)]
        gram = self.gram[np.ix_(kept, kept)] if with_prior.any() else self.gram
        span = ident.Span.of(system, with_prior[kept], gram)
        return replace(
            self, system=system, target=target[rows], span=span, values=span.remove(target[rows]),
            names=tuple(n for n in self.names if n not in set(given)), gram=gram,
        )  # fmt: skip

    def permuted(self, rng: np.random.Generator, count: int) -> Array:
        """Return the residual with the blocks of poses permuted and projected again: one column a permutation.

        A component gets the value zero if the pose permuted into its place did not measure the component.
        """
        present, unit = self.problem.weights > 0, self.block_of_pose
        blocks, out = np.zeros(present.shape), np.repeat(self.values[:, None], count, axis=1)
        blocks[present] = self.values[: self.measured]
        places = np.argsort(unit, kind="stable")
        for b in range(count):
            turned = np.empty_like(blocks)
            turned[places] = blocks[np.argsort(np.argsort(rng.permutation(unit.max() + 1))[unit], kind="stable")]
            out[: self.measured, b] = turned[present]
        return self.span.remove(out)

    @cached_property
    def block_registration(self) -> Array:
        """Basis of the registration columns that one block of poses alone determines, such as the columns of a bar."""
        columns = self.system[: self.measured]
        alone = nonzero_in_one_fold(columns, self.block_of_pose[self.problem.pose_of_row])
        return ident.orthonormal(columns[:, alone])

    def with_refitted_noise(self) -> "Residual":
        """Iterate the weights of the effects' priors until they agree with the residual's standard deviation.

        Without a large effect the residual exceeds the noise of the full model. With this noise, other effects would
        exceed their priors to explain the residual, and a small effect would replace the large one.
        """
        found = self
        for _ in range(STEPS):
            if len(found.values) == found.measured or found.sigma < SETTLED * found.noise:
                return found
            found = found._weighed_for(found.sigma)
        return found

    def _weighed_for(self, sigma: float) -> "Residual":
        """Weight the priors of the effects for a standard deviation `sigma` of the noise, m."""
        weight, rows = sigma / self.noise, slice(self.measured, None)
        system, target = self.system.copy(), self.target.copy()
        system[rows], target[rows] = weight * system[rows], weight * target[rows]
        gram = self.gram + (weight**2 - 1.0) * self.system[rows].T @ self.system[rows]
        span = self.span.weighed(rows, weight)
        return replace(
            self, system=system, target=target, span=span, values=span.remove(target), gram=gram, noise=sigma
        )

    @cached_property
    def contiguous_folds(self) -> "Residual":
        """The residual with folds of consecutive rows instead of random folds, so that neighbours are in one fold."""
        first = np.full(self.block_of_pose.max() + 1, np.inf)
        np.minimum.at(first, self.block_of_pose, self.poses.states["row"])
        stretch = stretches(first, self.criteria.folds)[self.block_of_pose]
        return replace(self, fold_of_row=stretch[self.problem.pose_of_row])

    @cached_property
    def fold_systems(self) -> tuple[Omitted, ...]:
        """Rows of each fold of the cross-validation, and the linear system without the rows of the fold."""
        folds = (np.flatnonzero(self.fold_of_row == fold) for fold in np.unique(self.fold_of_row))
        return tuple(Omitted.of(rows, self.span.basis) for rows in folds)


def residual_of(
    calibration: Calibration, poses: Poses, criteria: Criteria, seed: int, trusted: Mask | None = None
) -> Residual:
    """Form the residual of a calibration at poses, coordinates weighed equally; outliers are winsorised, not dropped.

    trusted: mask of the poses that are not winsorised. seed: seed of the random folds of cross-validation.
    """
    problem = problem_at(replace(calibration, noise_shape=None), poses)
    shrink = winsorising(problem, len(poses), criteria.outlier_sigmas)
    if trusted is not None:
        shrink[trusted] = 1.0
    system, target, names, sizing = _system(calibration, problem, shrink)
    with_prior = np.any(system[len(problem.residual) :] != 0, axis=0)
    gram = system.T @ system if with_prior.any() else system[:0, :0]
    span = ident.Span.of(system, with_prior, gram)
    fold = folds(poses.dataset, criteria.folds, np.random.default_rng(seed))[problem.pose_of_row]
    found = Residual(
        calibration, problem.poses, problem, system, target, span, span.remove(target), names, fold,
        independent_blocks(poses.dataset, criteria), criteria, gram, sizing,
    )  # fmt: skip
    return replace(found, noise=calibration.model.noise or found.sigma)


def _system(calibration: Calibration, problem: Linearised, shrink: Array) -> tuple[Array, Array, tuple[str, ...], int]:
    """Return columns and right side of the model, names of its effects, and number of prior rows on lengths.

    Prior rows on lengths and tool fix a scale that no measurement fixes: if all measured gaps are zero, a machine that
    shrinks to a point would have no residual.
    """
    shortened = problem.residual * shrink[problem.pose_of_row]
    model, theta, kept = calibration.model, calibration.theta, calibration.free
    free = problem.free(kept)
    priors = fit_priors(model, problem, theta, calibration.placement, kept)
    count = len(priors.rows) if without_positions(problem) else priors.effect_rows
    prior_rows, pull = priors.rows[:count], priors.rhs[:count]
    order = np.argsort(np.abs(prior_rows).argmax(axis=1), kind="stable")
    system = np.vstack([problem.columns[:, free], prior_rows[order][:, free]])
    scale = np.linalg.norm(system, axis=0)
    system /= np.where(scale > 0, scale, 1.0)
    names = tuple(e.name for e, k in zip(model.effects, kept, strict=True) if k)
    return system, np.concatenate([shortened, pull[order]]), names, count - priors.effect_rows


def winsorising(problem: Linearised, poses: int, sigmas: float) -> Array:
    """Return factors that limit each pose's residual to median + sigmas · 1.4826 MAD of the lengths of all poses."""
    length = np.sqrt(squares_by_pose(problem, problem.residual, poses))
    return np.minimum(1.0, outlier_limit(length, sigmas) / np.maximum(length, 1e-12))


def squares_by_pose(problem: Linearised, values: Array, poses: int) -> Array:
    """Return the sum of squares of the values of each pose's measured rows; 0 for a pose without measured rows."""
    return np.asarray(np.bincount(problem.pose_of_row, values**2, poses), dtype=float)
