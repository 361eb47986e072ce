"""Values of a formula between the rows of a table: a formula with a pole between rows describes the table worse.

A pole or a singularity between two rows has no effect on the residuals of the rows. The values of the formula and of
its parts are therefore also computed at random points between neighbouring rows.
"""

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, IntArray
from gpmodel.formula.program import Program

NEIGHBOURS = 8
"""Number of test points per table row, each at a random position between the row and one of its nearest neighbours. One
more point per input lies between the row and the row with the next value of the input, since rows around a gap are no
neighbours."""
EXPLODED = 2.0
"""Ratio of a part of a formula between rows to its largest value at the rows, above which the formula counts as
exploded. A linear part has a ratio below 1, a part with a pole between the rows about NEIGHBOURS."""
HALVINGS = 40
"""Number of bisections that locate a zero of a part of a formula, to 1e-12 of the distance between two rows."""
CROSSED = 16
"""Largest number of lines between rows on which a zero of one part is located; the part's zeros form one surface."""


class PointsBetween:
    """Points between neighbouring rows of a table, in each column, and the variance of the table's response."""

    def __init__(self, columns: Mapping[str, Array], variance: float, rng: np.random.Generator) -> None:
        table = np.unique(np.array(list(columns.values())).T, axis=0)
        deviation = table.std(axis=0)
        scaled = table / np.where(deviation > 0, deviation, 1.0)
        near = cKDTree(scaled).query(scaled, k=min(NEIGHBOURS + 1, len(table)))[1].reshape(len(table), -1)[:, 1:]
        self.rows, self.variance = len(table), variance
        order = np.argsort(table, axis=0, kind="stable")
        self.first = np.append(np.repeat(np.arange(len(table)), near.shape[1]), order[:-1].T)
        self.last = np.append(near, order[1:].T)
        self.place = rng.uniform(size=len(self.last))
        self.table, self.names = table, tuple(columns)
        self.columns = self._columns(np.concatenate([table, self._points(slice(None), self.place)]))

    def _points(self, lines: IntArray | slice, place: Array) -> Array:
        """Return points (points, inputs) at the positions ``place``, 0 to 1, on lines between rows."""
        begin, end = self.table[self.first[lines]], self.table[self.last[lines]]
        return np.asarray(begin + place[:, None] * (end - begin))

    def _columns(self, points: Array) -> dict[str, Array]:
        return dict(zip(self.names, points.T, strict=True))

    def loss(self, program: Program, factor: float = 1.0) -> float:
        """Return the mean square deviation of a formula with poles between rows, as a share of the response's variance.

        At points at which a part of the formula explodes, the formula's deviation from the line between the formula's
        values at both rows is used. An undefined value is replaced by the standard deviation of the response.
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

    def has_pole(self, program: Program) -> bool:
        """Return whether a formula explodes at a zero of one of its parts on a line between neighbouring rows.

        A part with opposite signs at a row and at the point on a line is zero between them. A quotient explodes at a
        zero of its denominator, unless its numerator is zero as well.
        """
        count = len(self.last)
        signs = np.sign(np.array(program.values(self.columns, self.rows + count)))
        begin = np.concatenate([signs[:, self.first], signs[:, self.rows :]], axis=1)
        end = np.concatenate([signs[:, self.rows :], signs[:, self.last]], axis=1)
        changes = begin * end < 0.0
        part, half = np.nonzero(changes & (np.cumsum(changes, axis=1) <= CROSSED))
        if not len(half):
            return False
        low, high = np.append(np.zeros(count), self.place)[half], np.append(self.place, np.ones(count))[half]
        line, before = half % count, begin[part, half]
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            found = np.array(program.values(self._columns(self._points(line, middle)), len(line)))
            same = np.sign(found[part, np.arange(len(line))]) == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        largest = np.abs(program.evaluate(self._columns(self.table))[0]).max()
        near = (program.evaluate(self._columns(self._points(line, place)))[0] for place in (low, high))
        return any(bool((np.abs(values) > EXPLODED * largest).any()) for values in near)
