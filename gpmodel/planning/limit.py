"""Lower bound of the goal over all sets of a given number of poses.

A choice of n poses is a measure of mass n over the pool; among all measures the variance is convex in the information
M, so that the tangent at any measure bounds every choice, and the best measure nearly meets it. Sources: Kiefer and
Wolfowitz (1960); the multiplicative steps, Silvey, Titterington and Torsney (1978), Yu (2010).
"""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from gpmodel.planning.design import LITTLE, Question, Variance

STEPS = 300
"""Multiplicative steps at most."""

CLOSE = 0.01
"""Share of the variance by which the bound may be short of the best measure: half a per cent of the deviation."""


def least_deviation(questions: Sequence[Question], count: int) -> float:
    """√ of the variance that no `count` poses of the pool can bring the worst answered of questions below.

    The same pose may be taken twice in what it is held against. Raises TypeError where no variance is asked about.
    """
    return max(_least(question, count) for question in questions)


def _least(question: Question, count: int) -> float:
    if not isinstance(question.goal, Variance):
        raise TypeError("a deviation is that of a Variance")
    columns, weight = question.columns, question.goal.weight
    known = question.known + LITTLE * np.eye(len(question.known))
    share, best = np.full(len(columns), 1.0 / len(columns)), 0.0
    for _ in range(STEPS):
        rows = (columns * np.sqrt(share)[:, None, None]).reshape(-1, columns.shape[2])
        inverse = linalg.inv(known + count * rows.T @ rows)
        variance = float(np.trace(inverse @ weight))
        slope = np.sum((columns @ (inverse @ weight @ inverse)) * columns, axis=(1, 2))
        mean = float(share @ slope)
        best = max(best, variance - count * (float(slope.max()) - mean))
        if best > (1.0 - CLOSE) * variance:
            break
        share = share * np.sqrt(slope / mean)
        share /= share.sum()
    return float(np.sqrt(best))
