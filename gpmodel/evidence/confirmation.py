"""Never worse than before: what was found against the standard model, on the poses that chose nothing."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import paired_t
from gpmodel.evidence.residual import independent_units
from gpmodel.model.error_model import Poses
from gpmodel.numerics.outliers import outlier_limit


@dataclass(frozen=True)
class Confirmation:
    """Paired test of two models on held-out poses.

    t: mean of (squared error of the first - of the second) over `units` independent units of poses, in standard
    errors of that mean. p_value: one-sided chance of it between equally good models. passed: whether it is below its
    limit.
    """

    t: float
    p_value: float
    limit: float
    units: int
    passed: bool


def confirmation(standard: Calibration, found: Calibration, heldout: Poses, criteria: Criteria) -> Confirmation:
    """Test whether the found model predicts held-out poses better than the standard model."""
    unit = independent_units(heldout.dataset, criteria)
    return paired(errors_on(standard, heldout), errors_on(found, heldout), unit, criteria)


def paired(before: Array, after: Array, units: IntArray, criteria: Criteria) -> Confirmation:
    """Paired test of the 3-D errors (N,) of two models on poses that neither was chosen on; NaN: no error is known.

    units: (N,) code of the poses that count as one observation.
    Both models' errors are winsorised at median + 6 · 1.4826 MAD of the standard model's: one bad measurement neither
    proves nor disproves. A single unit of poses proves nothing: p is 1.
    """
    known = np.isfinite(before) & np.isfinite(after)
    errors = before[known], after[known]
    limit = outlier_limit(errors[0], criteria.outlier_sigmas)
    squared = [np.minimum(e, limit) ** 2 for e in errors]
    unit = np.unique(units[known], return_inverse=True)[1].reshape(-1)
    gain = np.bincount(unit, squared[0] - squared[1]).astype(float)
    t = paired_t(gain) if len(gain) > 1 else 0.0
    p = float(special.stdtr(len(gain) - 1, -t)) if t else 1.0
    return Confirmation(t, p, criteria.confirmation, len(gain), p < criteria.confirmation)
