"""Poses that stand out of a model with a curve: outliers, or where a law is sharper than the curve can be.

A smooth curve leaves most at a kink or a step. Winsorised there, the residual would refuse the law that has it.
"""

from collections.abc import Sequence

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.evidence.residual import Residual, residual_of, squares, winsorising
from gpmodel.evolution.description_length import fit_nats
from gpmodel.families.candidate import Candidate
from gpmodel.numerics.outliers import outlier_limit
from gpmodel.table.split import JUDGED

GROSS = 2.0
"""Times the second largest that an error without the curve may be; a larger one is that of the measurement."""


def doubtful(left: Residual, curve: Candidate) -> Mask:
    """Poses (N,) that stand out of a model with a curve, but are no gross errors beside others without it."""
    motion = left.columns(curve.effects) @ np.array(left.calibration.values_of(curve.effects))
    before = _lengths(left, left.problem.residual + motion)
    out = winsorising(left.problem, len(left.poses), left.criteria.outlier_sigmas) < 1.0
    return np.asarray(out & (before <= GROSS * np.sort(before)[-2:].min(initial=np.inf)))


def taken_as_measured(left: Residual, poses: Mask) -> Residual:
    """The residual with some of its poses (N,) as they are, the others winsorised."""
    return residual_of(left.calibration, left.poses, left.criteria, JUDGED, poses)


def explained(residual: Residual, laws: Sequence[Candidate]) -> Mask:
    """Poses (N,) that do not stand out of the model with the likeliest of some laws, where what stands out of one
    counts as if it stood at the limit. residual: without them."""
    sigmas, found = residual.criteria.outlier_sigmas, list[tuple[float, Mask]]()
    for law in laws:
        columns, _ = residual.projected(law.effects)
        left = residual.values - columns @ np.linalg.lstsq(columns, residual.values, rcond=None)[0]
        errors = _lengths(residual, left[: residual.measured])
        limit = outlier_limit(errors, sigmas)
        gain = 1.0 - float(np.sum(np.minimum(errors, limit) ** 2)) / residual.energy
        found.append((law.cost - float(fit_nats(gain, residual.freedom)), errors <= limit))
    return min(found, key=lambda one: one[0])[1]


def _lengths(residual: Residual, values: Array) -> Array:
    """Length (N,) of the values (M,) of each pose."""
    return np.sqrt(squares(residual.problem, values, len(residual.poses)))
