"""Fit a table by least squares with the true form of every effect."""

from __future__ import annotations

import numpy as np

from experiments.blind.judge import told
from experiments.blind.oracle import decomposed, fit, jacobian
from experiments.blind.robot import Robot


def deviations(robot: Robot) -> list[float]:
    """(value - value of the fit to exact positions) / standard deviation of every column of the effects
    that the poses show."""
    train, known = robot.train, told(robot)
    q, measured, columns = train.q[known.good], train.measured[known.good], known.columns
    points = (measured, train.clean[known.good])
    ours, exact = (fit(robot.arm, q, measured, columns, known.start) for measured in points)
    matrix = jacobian(robot.arm, *known.start, ours.amounts, q, columns)
    _, sizes, turn, scale = decomposed(matrix)
    left = measured - ours.predict(q, columns)
    variance = np.sum(left**2) / (left.size - len(sizes))
    spread = np.sqrt(variance * np.sum((turn / sizes[:, None]) ** 2, axis=0)) / scale
    own = slice(len(spread) - len(columns), None)
    shown = spread[own] > 0
    return [round(float(z), 2) for z in (ours.amounts - exact.amounts)[own][shown] / spread[own][shown]]
