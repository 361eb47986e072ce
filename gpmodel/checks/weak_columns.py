"""Columns that hardly move the measured point: the other readings of them, judged by the standard model."""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.checks.foreign_column import fitted, foreign_column
from gpmodel.checks.misfit import Registered, flange, least_misfit, registered
from gpmodel.checks.mixed_up import FEWEST_ROWS, MOST_ROWS, comparable_rows, typical
from gpmodel.checks.readings import Reading, of_joints
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import measured_minus, observe, prepare
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset

WEAK = 10.0
"""Times what registration and tool leave that a joint moves the point by, RMS, below which its column may be read
wrongly without leaving more. The wrong sign of a column leaves about twice what the joint moves."""
NOT_WORSE = 1.2
"""Times what the table leaves as it stands that another reading may leave of registration and tool."""
BETTER, SURE = 1.5, 25.0
"""Times less the standard model has to leave of another reading; and nats of likelihood by which. The wrong sign of a
wrist leaves twenty times more, of a sound table no other reading leaves less."""


def misread(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> str | None:
    """The column of a joint that hardly moves the point, where another reading of it, or free angles, fit far better.

    Registration and tool of the nominal geometry leave more than such a column matters. Hence both readings are fitted
    with the standard model, and compared by their likelihoods: no reading has more unknowns than another.
    """
    rows = comparable_rows(data)
    rows = rows[:: max(1, len(rows) // MOST_ROWS)]
    turned = all(j.measured for j in mechanism.joints) and not closed(mechanism)
    if len(rows) < FEWEST_ROWS or branched(mechanism) or not turned:
        return None
    frames = flange(mechanism, data.q[rows])
    most, errors = typical(frames, data.position[rows])
    rows, frames, now = rows[most], frames[most], root_mean_square(errors[most])
    q, p = data.q[rows], data.position[rows]
    weak = _moved_by(mechanism, q, registered(frames, p)) < WEAK * now
    if not weak.any():
        return None
    fit = fitted(mechanism, data.subset(rows), standard)
    own = _left(fit, data.subset(rows))
    best: tuple[float, float, Reading] | None = None
    for reading in of_joints(mechanism, q, p, weak):
        if np.array_equal(reading.q, q) or least_misfit(flange(mechanism, reading.q), p) > NOT_WORSE * now:
            continue
        otherwise = replace(data.subset(rows), q=reading.q)
        left = _left(fitted(mechanism, otherwise, standard), otherwise)
        gain = sum(count * np.log(max(a, 1e-12) / max(b, 1e-12)) for (a, count), (b, _) in zip(own, left, strict=True))
        if gain > SURE and gain > np.log(BETTER) * sum(count for _, count in own) and (best is None or gain > best[0]):
            best = float(gain), left[0][0], reading
    if best is None:
        turning = [k for k in np.flatnonzero(weak).tolist() if mechanism.joints[k].kind == "revolute"]
        foreign = (foreign_column(mechanism, data.subset(rows), fit, k) for k in turning)
        return next((text for text in foreign if text), None)
    return (
        f"{best[2].meaning}; the standard model then leaves {1e3 * best[1]:.3g} mm, "
        f"as it stands {1e3 * own[0][0]:.3g} mm"
    )


def _moved_by(mechanism: Mechanism, q: Array, found: Registered) -> Array:
    """RMS distance (n,), m, that each joint moves the point by about its mean value."""
    here = flange(mechanism, q)
    moved = [found.errors(here, found.points(flange(mechanism, _still(q, k)))) for k in range(q.shape[1])]
    return np.array([root_mean_square(distance) for distance in moved])


def _still(q: Array, k: int) -> Array:
    out = q.copy()
    out[:, k] = q[:, k].mean()
    return out


def _left(fit: Calibration, data: Dataset) -> list[tuple[float, int]]:
    """RMS of what a fit leaves of positions, m, and of rotations, rad, each with its number of values."""
    observed = observe(fit.model, prepare(fit.model.mechanism, data), fit.theta, fit.placement)
    left = np.delete(measured_minus(observed, data), fit.outliers, axis=0)
    parts = (left[:, :3], left[:, 3:6]) if data.has_rotation else (left[:, :3],)
    known = [values[np.isfinite(values)] for values in parts]
    return [(root_mean_square(values), len(values)) for values in known]
