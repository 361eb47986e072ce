"""Test alternative interpretations of the columns of joints that hardly move the measured point."""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.checks.mixed_up import FEWEST_ROWS, MOST_ROWS, comparable_rows, typical_rows
from gpmodel.checks.notes import Registered, flange, least_misfit, registered
from gpmodel.checks.readings import Reading, joint_readings
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, measured_minus, observe, prepare
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.blocks import SAME_JOINT
from gpmodel.table.dataset import Dataset

LIMIT = 50.0
"""Condition limit of calibrations that test columns of joints, as for the standard model in Robertson (2003)."""
PASSES = 3
"""Number of alternating fits of joint angles and model. For a wrist column of other rows and a point 1.5 mm off the
axis, the first fit reduces the residual from 1.1 to 0.17 mm, the third fit to 0.05 mm."""
GRID = np.radians(np.arange(0.0, 360.0, 2.0))
"""Trial joint angles, rad. Half a step of the trial angles moves the point of a wrist by less than the noise."""
LESS, FAR_LESS = 1.5, 3.0
"""Least factor by which free joint angles must reduce the standard deviation of the residual, in each fit and in all.
If the joint's column is correct, free angles remove one of three coordinates of the residual, a factor of 1.2."""
FAR_OFF = np.radians(10.0)
"""Least median difference of free joint angles from the table's column, rad, for the column to be wrong. Play and gear
errors are below 1 degree, shuffled columns differ by about 90."""


def fitted(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> Calibration:
    """Fit the standard model to a table."""
    return calibrate(ErrorModel(mechanism, standard), prepare(mechanism, data), condition_limit=LIMIT)


def foreign_column(mechanism: Mechanism, data: Dataset, fit: Calibration, k: int) -> str | None:
    """Describe the column of revolute joint k if the positions fit far better with a free angle at each pose; else
    return None.

    If the angle of joint k changes, the predicted point moves on a circle. The free angle minimises the distance of the
    predicted point from the measured point. Angles and standard model are fitted in turn, starting from `fit`, the
    standard model. The standard deviation of the residual allows for one unknown per pose.
    """
    now, free = fit, data
    for _ in range(PASSES):
        free = _nearest(now, free, k)
        now = fitted(mechanism, free, fit.model.effects)
        if LESS * now.sigma > fit.sigma:
            return None
    sigma = now.sigma * np.sqrt(now.freedom / max(now.freedom - len(data), 1.0))
    turned = np.exp(1j * (free.q[:, k] - data.q[:, k]))
    off = float(np.median(np.abs(np.angle(turned / np.mean(turned)))))
    if FAR_LESS * sigma > fit.sigma or off < FAR_OFF:
        return None
    return (
        f"column '{mechanism.joints[k].name}' does not match these positions: with fitted angles, the "
        "residual of the standard "
        f"model is {1e3 * sigma:.3g} mm instead of {1e3 * fit.sigma:.3g} mm, and the angles change by "
        f"{np.degrees(off):.3g} deg; expected the joint values of the pose of each row"
    )


def _nearest(fit: Calibration, data: Dataset, k: int) -> Dataset:
    """Return the table with the angle of joint k that minimises the distance of predicted and measured point."""
    zero, quarter, half = (_points(fit, _with(data, k, angle)) for angle in (0.0, np.pi / 2, np.pi))
    centre, cosine = (zero + half) / 2, (zero - half) / 2
    circle = (
        centre[:, None] + np.cos(GRID)[:, None] * cosine[:, None] + np.sin(GRID)[:, None] * (quarter - centre)[:, None]
    )
    return _with(data, k, GRID[np.linalg.norm(data.position[:, None] - circle, axis=2).argmin(axis=1)])


def _points(fit: Calibration, data: Dataset) -> Array:
    """Return the measured points (poses, 3), m, as the fitted model predicts them."""
    poses = prepare(fit.model.mechanism, data)
    return np.asarray(data.position - measured_minus(observe(fit.model, poses, fit.theta, fit.placement), data)[:, :3])


def _with(data: Dataset, k: int, angles: Array | float) -> Dataset:
    q = data.q.copy()
    q[:, k] = angles
    return replace(data, q=q)


WEAK = 10.0
"""Ratio of the RMS motion of the point by a joint to the residual of registration and tool. With a smaller ratio a
wrong interpretation of a joint's column does not increase the residual. The residual of a column with a wrong sign is
about twice the motion by the joint."""
NOT_WORSE = 1.2
"""Largest ratio of the residual of registration and tool with other columns to the residual of the present columns."""
BETTER, SURE = 1.5, 25.0
"""Least factor by which another interpretation of a column has to reduce the residual of the standard model; and least
gain in log likelihood, nats. A wrong sign of a wrist gains twenty times more; no change improves a sound table."""


def misread_column(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> str | None:
    """Describe the column of a joint that hardly moves the point, if other values or free angles fit far better.

    The residual of registration and tool alone exceeds the effect of such a column. Original and alternative column are
    therefore fitted with the standard model and compared by the likelihood, with equal numbers of unknowns. The column
    of a joint at rest shows nothing: added to a moving joint, it makes another arm that may fit an effect better.
    """
    rows = comparable_rows(data)
    rows = rows[:: max(1, len(rows) // MOST_ROWS)]
    turned = all(j.measured for j in mechanism.joints) and not closed(mechanism)
    if len(rows) < FEWEST_ROWS or branched(mechanism) or not turned:
        return None
    frames = flange(mechanism, data.q[rows])
    most, errors = typical_rows(frames, data.position[rows])
    rows, frames, now = rows[most], frames[most], root_mean_square(errors[most])
    q, p = data.q[rows], data.position[rows]
    weak = (_moved_by(mechanism, q, registered(frames, p)) < WEAK * now) & (np.ptp(q, axis=0) > SAME_JOINT)
    if not weak.any():
        return None
    fit = fitted(mechanism, data.subset(rows), standard)
    own = _left(fit, data.subset(rows))
    best: tuple[float, float, Reading] | None = None
    for reading in joint_readings(mechanism, q, p, weak):
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
        f"{best[2].meaning}; the residual of the standard model is then {1e3 * best[1]:.3g} mm "
        f"instead of {1e3 * own[0][0]:.3g} mm"
    )


def _moved_by(mechanism: Mechanism, q: Array, found: Registered) -> Array:
    """Return the RMS displacement of the point by each joint, m, relative to the mean joint value."""
    here = flange(mechanism, q)
    moved = [found.errors(here, found.points(flange(mechanism, _still(q, k)))) for k in range(q.shape[1])]
    return np.array([root_mean_square(distance) for distance in moved])


def _still(q: Array, k: int) -> Array:
    out = q.copy()
    out[:, k] = q[:, k].mean()
    return out


def _left(fit: Calibration, data: Dataset) -> list[tuple[float, int]]:
    """Return the RMS residual and the number of values of positions, m, and of rotations, rad."""
    observed = observe(fit.model, prepare(fit.model.mechanism, data), fit.theta, fit.placement)
    left = np.delete(measured_minus(observed, data), fit.outliers, axis=0)
    parts = (left[:, :3], left[:, 3:6]) if data.has_rotation else (left[:, :3],)
    known = [values[np.isfinite(values)] for values in parts]
    return [(root_mean_square(values), len(values)) for values in known]
