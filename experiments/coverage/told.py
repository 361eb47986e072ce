"""Least squares told the form of every effect, on the same table: what the draw of its noise leaves to anybody."""

from __future__ import annotations

import numpy as np

from experiments.blind.oracle import CUT, fit, jacobian, register
from experiments.blind.robot import Robot


def deviations(robot: Robot) -> list[float]:
    """(value - value of the fit to exact positions) / standard deviation of every column of the effects
    that the poses show."""
    train = robot.train
    good = np.setdiff1d(np.arange(len(train.q)), train.outliers)
    q, measured, clean = train.q[good], train.measured[good], train.clean[good]
    start = register(robot.arm, q, measured)
    plain = fit(robot.arm, q, measured, [], start)
    columns = robot.columns(train, plain.tool + plain.amounts[6:9], start[0])
    told = [{slot: twist[good] for slot, twist in column.items()} for column in columns]
    ours, exact = (fit(robot.arm, q, points, told, start) for points in (measured, clean))
    matrix = jacobian(robot.arm, *start, ours.amounts, q, told)
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale < 1e-9 * scale.max()] = np.inf
    _, sizes, turn = np.linalg.svd(matrix / scale, full_matrices=False)
    keep = sizes > CUT * sizes[0]
    left = measured - ours.predict(q, told)
    variance = np.sum(left**2) / (left.size - keep.sum())
    spread = np.sqrt(variance * np.sum((turn[keep] / sizes[keep, None]) ** 2, axis=0)) / scale
    own = slice(len(spread) - len(told), None)
    shown = spread[own] > 0
    return [round(float(z), 2) for z in (ours.amounts - exact.amounts)[own][shown] / spread[own][shown]]
