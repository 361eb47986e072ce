"""Cross-validation: how well a model with candidate effects predicts poses that did not fit it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, Mask
from gpmodel.discovery.residual import Residual
from gpmodel.model.effect import Effect
from gpmodel.numerics.least_squares import MANY_COLUMNS, solve
from gpmodel.numerics.outliers import outlier_limit


@dataclass(frozen=True)
class Predicted:
    """3-D RMS of the predictions, m; squared error (U,) summed over each independent unit of poses, m²; coefficients
    (folds, E) of the effects."""

    rms: float
    per_unit: Array
    coefficients: Array


def cross_validated(residual: Residual, effects: Sequence[Effect]) -> Predicted:
    """Predictions with these effects in the model, all of it refitted without each fold."""
    extra = residual.columns(effects)
    scale = np.linalg.norm(extra, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    sigma = np.sqrt(residual.energy / residual.freedom)
    extra, belief = extra / scale, np.array([sigma / e.prior for e in effects]) / scale
    fits = _updated if residual.system.shape[1] + extra.shape[1] >= MANY_COLUMNS else _refitted
    target, system = residual.target[: residual.measured], residual.system[: residual.measured]
    per_pose = np.zeros(len(residual.poses))
    coefficients = []
    for test, old, new in fits(residual, extra, belief):
        miss = target[test] - system[test] @ old - extra[test] @ new
        np.add.at(per_pose, residual.problem.pose_of_row[test], miss**2)
        coefficients.append(new / scale)
    per_unit = np.bincount(residual.unit_of_pose, per_pose).astype(float)
    return Predicted(float(np.sqrt(per_pose.mean())), per_unit, np.array(coefficients))


def paired_t(gain: Array) -> float:
    """The mean of a gain (N,) in standard deviations of that mean; 0 where all are equal."""
    spread = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    return float(gain.mean()) / spread if spread > 0 else 0.0


def gained(before: Predicted, after: Predicted, sigmas: float) -> float:
    """The paired t by which one prediction is better than another, unit by unit of independent poses.

    Both errors count up to median + sigmas · 1.4826 MAD of those before: where a curve has few poses, one of them
    missed by far neither proves nor disproves.
    """
    limit = outlier_limit(np.sqrt(before.per_unit), sigmas) ** 2
    return paired_t(np.minimum(before.per_unit, limit) - np.minimum(after.per_unit, limit))


def better_by(residual: Residual, effects: Sequence[Effect], others: Sequence[Effect] = ()) -> float:
    """The paired t by which effects predict better than others, unit by unit of independent poses."""
    before, after = cross_validated(residual, others), cross_validated(residual, effects)
    return gained(before, after, residual.criteria.outlier_sigmas)


def _refitted(residual: Residual, extra: Array, belief: Array) -> Iterator[tuple[Mask, Array, Array]]:
    """Of each fold: its rows, and coefficients of the system and of the extra columns solved together without them."""
    count, below = residual.system.shape[1], len(residual.target) - residual.measured
    columns = np.hstack([residual.system, np.vstack([extra, np.zeros((below, extra.shape[1]))])])
    rows = np.hstack([np.zeros((len(belief), count)), np.diag(belief)])[belief > 0]
    for fold in np.unique(residual.fold_of_row):
        test = residual.fold_of_row == fold
        keep = np.concatenate([~test, np.ones(below, dtype=bool)])
        solved = solve(np.vstack([columns[keep], rows]), np.concatenate([residual.target[keep], np.zeros(len(rows))]))
        yield test, solved[:count], solved[count:]


def _updated(residual: Residual, extra: Array, belief: Array) -> Iterator[tuple[Mask, Array, Array]]:
    """The same from each fold's factored normal equations, by block elimination of the extra columns.

    Products over all rows less those of the fold are the products without it.
    """
    system, target = residual.system[: residual.measured], residual.target[: residual.measured]
    across, own, pull = system.T @ extra, extra.T @ extra + np.diag(belief**2), extra.T @ target
    for test, factor, base in residual.without_folds:
        between = across - system[test].T @ extra[test]
        solved = linalg.cho_solve(factor, between, check_finite=False)
        inner = own - extra[test].T @ extra[test] - between.T @ solved
        right = pull - extra[test].T @ target[test] - between.T @ base
        new = linalg.lstsq(inner, right, cond=1e-12)[0]
        yield test, base - solved @ new, new
