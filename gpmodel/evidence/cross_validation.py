"""Compare the predictions of two models, by cross-validation or on poses that were not used for the search."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, special

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, independent_blocks
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.numerics.rank import NEGLIGIBLE


@dataclass(frozen=True)
class Predicted:
    """Predictions of the held-out poses of each fold. rms: 3-D RMS error, m. per_unit: sum of squared errors of each
    block of poses, m². coefficients: coefficients of the effects fitted without each fold, in SI units."""

    rms: float
    per_unit: Array
    coefficients: Array


def cross_validated(residual: Residual, effects: Sequence[Effect]) -> Predicted:
    """Compute the cross-validated errors of the model with some effects, with one factorisation for all folds.

    With the projected columns X of the effects, the residual r, their rows x and r_f in a fold, and A = I - H, H the
    hat matrix of these rows, the products XᵀX and Xᵀr without the fold are XᵀX - xᵀA⁻¹x and Xᵀr - xᵀA⁻¹r_f. The
    coefficients β of these products leave the error A⁻¹ (r_f - x β) in the fold. Source: Cook and Weisberg (1982), 2.2.
    """
    scale = np.linalg.norm(residual.columns(effects), axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    prior_weight = np.array([residual.sigma / e.prior for e in effects]) / scale
    left, shares = residual.projected(effects)
    both = np.column_stack([left * (shares > NEGLIGIBLE), residual.values])
    products = both[:, :-1].T @ both
    products[:, :-1] += np.diag(prior_weight**2)
    per_pose = np.zeros(len(residual.poses))
    coefficients = []
    for fold in residual.fold_systems:
        freed = fold.freed(both[fold.rows])
        apart = products - both[fold.rows, :-1].T @ freed
        new = linalg.lstsq(apart[:, :-1], apart[:, -1], cond=1e-12, lapack_driver="gelsy", check_finite=False)[0]
        np.add.at(per_pose, residual.problem.pose_of_row[fold.rows], (freed[:, -1] - freed[:, :-1] @ new) ** 2)
        coefficients.append(new / scale)
    per_unit = np.bincount(residual.block_of_pose, per_pose).astype(float)
    return Predicted(float(np.sqrt(per_pose.mean())), per_unit, np.array(coefficients))


def paired_t(gain: Array) -> float:
    """Return the mean of values, such as error reductions, over its standard error; 0 if all values are equal."""
    spread = float(np.std(gain, ddof=1)) / np.sqrt(len(gain))
    return float(gain.mean()) / spread if spread > 0 else 0.0


def gained(before: Predicted, after: Predicted, sigmas: float) -> float:
    """Return the paired t of the squared errors of two predictions over blocks, positive if `after` is better.

    The errors of both predictions are limited to median + sigmas · 1.4826 MAD of the errors of `before`. Without a
    limit, one pose that a smooth function misses by far would decide the test.
    """
    limit = outlier_limit(np.sqrt(before.per_unit), sigmas) ** 2
    return paired_t(np.minimum(before.per_unit, limit) - np.minimum(after.per_unit, limit))


def better_by(residual: Residual, effects: Sequence[Effect], others: Sequence[Effect] = ()) -> float:
    """Return the paired t of cross-validated squared errors over blocks, positive if `effects` beat `others`."""
    before, after = cross_validated(residual, others), cross_validated(residual, effects)
    return gained(before, after, residual.criteria.outlier_sigmas)


@dataclass(frozen=True)
class Confirmation:
    """Paired test of two models on held-out poses.

    t: mean reduction of squared error by the second model over `units` independent blocks, in standard errors. p_value:
    one-sided probability of a reduction as large between equally good models.
    passed: whether the p-value is below the limit `confirmation` of `Criteria`.
    """

    t: float
    p_value: float
    limit: float
    units: int
    passed: bool


def confirmation(standard: Calibration, found: Calibration, heldout: Poses, criteria: Criteria) -> Confirmation:
    """Test whether the model with findings predicts held-out poses better than the standard model, equally weighted."""
    unit = independent_blocks(heldout.dataset, criteria)
    return paired(errors_on(standard, heldout, found.weights), errors_on(found, heldout), unit, criteria)


def paired(before: Array, after: Array, units: IntArray, criteria: Criteria) -> Confirmation:
    """Test whether the second of two models has smaller 3-D errors on poses that selected neither model.

    before, after: errors of each pose by the two models, m, NaN if unknown; a pose with both above median + 6 · 1.4826
    MAD of the first model's errors has no weight. units: block index of each pose. With a single block p_value = 1."""
    known = np.isfinite(before) & np.isfinite(after)
    errors = before[known], after[known]
    limit = outlier_limit(errors[0], criteria.outlier_sigmas)
    gained = np.where(np.minimum(*errors) > limit, 0.0, errors[0] ** 2 - errors[1] ** 2)
    unit = np.unique(units[known], return_inverse=True)[1].reshape(-1)
    gain = np.bincount(unit, gained).astype(float)
    t = paired_t(gain) if len(gain) > 1 else 0.0
    p = float(special.stdtr(len(gain) - 1, -t)) if t else 1.0
    return Confirmation(t, p, criteria.confirmation, len(gain), p < criteria.confirmation)
