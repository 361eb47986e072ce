"""A column of joint values that belongs to other poses: shuffled, or of another measurement."""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, measured_minus, observe, prepare
from gpmodel.table.dataset import Dataset

LIMIT = 50.0
"""Condition limit of every fit. As of the standard model in the thesis."""
PASSES = 3
"""Alternating passes over angles and model. The first takes a shuffled wrist 1.5 mm off its axis from 1.1 to 0.17
mm, the third to 0.05; a sound column never changes.
"""
GRID = np.radians(np.arange(0.0, 360.0, 2.0))
"""Angles that are tried; half the step moves a wrist's point by less than its noise."""
LESS, FAR_LESS = 1.5, 3.0
"""Times smaller that free angles have to make the standard deviation of the residual, after each pass and in the end.
They take one of three coordinates from what is missing in a sound model, a factor of 1.2."""
FAR_OFF = np.radians(10.0)
"""Median difference of the free angles from the column: play and gear errors are below 1 degree, shuffled values near
90."""


def fitted(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> Calibration:
    """Fit the standard model."""
    return calibrate(ErrorModel(mechanism, standard), prepare(mechanism, data), condition_limit=LIMIT)


def foreign_column(mechanism: Mechanism, data: Dataset, fit: Calibration, k: int) -> str | None:
    """Name the column of revolute joint k where the positions fit far better with its angles free.

    Each pose's own angle is the one whose point is nearest to the measured one; the point moves on a circle. Angles and
    standard model are found in turn, from `fit`, the standard model of the table as it stands. σ of the residual counts
    one unknown a pose.
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
        f"column '{mechanism.joints[k].name}' does not belong to these positions: with its angles free the standard "
        f"model leaves {1e3 * sigma:.3g} mm, as it stands {1e3 * fit.sigma:.3g} mm, and they differ by "
        f"{np.degrees(off):.3g} deg; expected the values of the pose of each row"
    )


def _nearest(fit: Calibration, data: Dataset, k: int) -> Dataset:
    """The table with the angle of joint k that puts each point of the model nearest to the measured one."""
    zero, quarter, half = (_points(fit, _with(data, k, angle)) for angle in (0.0, np.pi / 2, np.pi))
    centre, cosine = (zero + half) / 2, (zero - half) / 2
    circle = (
        centre[:, None] + np.cos(GRID)[:, None] * cosine[:, None] + np.sin(GRID)[:, None] * (quarter - centre)[:, None]
    )
    return _with(data, k, GRID[np.linalg.norm(data.position[:, None] - circle, axis=2).argmin(axis=1)])


def _points(fit: Calibration, data: Dataset) -> Array:
    """Points (N, 3), m, that the model predicts."""
    poses = prepare(fit.model.mechanism, data)
    return np.asarray(data.position - measured_minus(observe(fit.model, poses, fit.theta, fit.placement), data)[:, :3])


def _with(data: Dataset, k: int, angles: Array | float) -> Dataset:
    q = data.q.copy()
    q[:, k] = angles
    return replace(data, q=q)
