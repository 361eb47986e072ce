"""Values of a formula between the rows of a table: a formula with a pole between rows describes the table worse.

A pole or a singularity between two rows has no effect on the residuals of the rows. The values of the formula and of
its parts are therefore also computed at random points between neighbouring rows.
"""

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from gpmodel.arrays import Array
from gpmodel.formula.program import Program

NEIGHBOURS = 8
"""Number of test points per table row, each at a random position between the row and one of its nearest neighbours."""
EXPLODED = 2.0
"""Ratio of a part of a formula between rows to its largest value at the rows, above which the formula counts as
exploded. For a linear part the ratio is below 1; at a pole between the rows about NEIGHBOURS."""


class PointsBetween:
    """Points between neighbouring rows of the columns of a table, and the variance of the response of the table."""

    def __init__(self, columns: Mapping[str, Array], variance: float, rng: np.random.Generator) -> None:
        table = np.unique(np.array(list(columns.values())).T, axis=0)
        deviation = table.std(axis=0)
        scaled = table / np.where(deviation > 0, deviation, 1.0)
        near = cKDTree(scaled).query(scaled, k=min(NEIGHBOURS + 1, len(table)))[1].reshape(len(table), -1)[:, 1:]
        self.rows, self.variance = len(table), variance
        self.first, self.last = np.repeat(np.arange(len(table)), near.shape[1]), near.ravel()
        self.place = rng.uniform(size=len(self.last))
        points = table[self.first] + self.place[:, None] * (table[self.last] - table[self.first])
        self.columns = dict(zip(columns, np.concatenate([table, points]).T, strict=True))

    def loss(self, program: Program, factor: float = 1.0) -> float:
        """Return the mean square deviation of a formula with poles between rows, as a share of the response's variance.

        At points at which a part of the formula explodes, its deviation from the line between its values at both rows
        is used. An undefined value is replaced by the standard deviation of the response.
        """
        if not len(self.last):
            return 0.0
        parts = np.array(program.values(self.columns, self.rows + len(self.last)))
        whole = factor * parts[program.outputs[0]]
        with np.errstate(all="ignore"):
            largest = np.abs(parts[:, : self.rows]).max(axis=1, keepdims=True)
            exploded = (~(np.abs(parts[:, self.rows :]) <= EXPLODED * largest)).any(axis=0)
            line = whole[self.first] + self.place * (whole[self.last] - whole[self.first])
            shares = np.square(whole[self.rows :] - line)[exploded] / self.variance
        return float(np.where(np.isfinite(shares), shares, 1.0).sum() / len(self.last))
