"""Pugh charts: concepts scored against a baseline by plus and minus marks (thesis Tables 2.6 and 2.12)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError, choices


@dataclass(frozen=True)
class PughChart:
    """A Pugh chart. marks: (criteria, concepts) integers, plus marks positive. weights: (criteria,)."""

    title: str
    concepts: tuple[str, ...]
    criteria: tuple[str, ...]
    marks: IntArray
    weights: Array

    @property
    def scores(self) -> Array:
        """Weighted sum of plus marks minus minus marks of each concept."""
        return self.weights @ self.marks

    @property
    def pluses(self) -> IntArray:
        """Number of plus marks of each concept; "++" counts as two."""
        return np.asarray(np.maximum(self.marks, 0).sum(axis=0))

    @property
    def minuses(self) -> IntArray:
        """Number of minus marks of each concept."""
        return np.asarray(np.maximum(-self.marks, 0).sum(axis=0))

    @property
    def ranking(self) -> tuple[str, ...]:
        """Concepts from best to worst; equal scores keep the order of the chart."""
        return tuple(self.concepts[i] for i in np.argsort(-self.scores, kind="stable"))


def read_mark(text: str, where: str) -> int:
    """Return the value of a mark: "0" is 0, "+" 1, "++" 2, "-" -1 and so on."""
    mark = text.strip()
    if mark == "0":
        return 0
    if mark and set(mark) in ({"+"}, {"-"}):
        return len(mark) if mark[0] == "+" else -len(mark)
    raise InputError(f"{where}: mark '{text}', expected 0, or plus or minus signs such as ++")


def pugh_chart(
    title: str,
    concepts: Sequence[str],
    marks: Mapping[str, Sequence[str | int]],
    weights: Mapping[str, float] | None = None,
) -> PughChart:
    """Build a chart from marks {criterion: [one mark per concept]}; the weight of a criterion is 1 unless given.

    Raises InputError for a row of wrong length, an invalid mark, or a weight of an unknown criterion.
    """
    if not concepts or not marks:
        raise InputError(f"Pugh chart '{title}': no concepts or no criteria, expected at least one of each")
    rows = []
    for criterion, row in marks.items():
        where = f"Pugh chart '{title}', {criterion}"
        if len(row) != len(concepts):
            raise InputError(f"{where}: {len(row)} marks, expected {len(concepts)}, one per concept")
        rows.append([read_mark(str(mark), where) for mark in row])
    given = dict(weights or {})
    unknown = [name for name in given if name not in marks]
    if unknown:
        raise InputError(
            f"Pugh chart '{title}': unknown criterion '{unknown[0]}', expected one of {choices(unknown[0], marks)}"
        )
    weight = np.array([float(given.get(name, 1.0)) for name in marks])
    return PughChart(title, tuple(concepts), tuple(marks), np.array(rows, int), weight)
