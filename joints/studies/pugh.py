"""`gpmodel joint pugh`: concepts scored against a baseline by plus and minus marks (thesis Tables 2.6 and 2.12)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError, choices
from joints.settings import DATA, read_toml
from joints.studies.study import Study, Table


@dataclass(frozen=True)
class PughChart:
    """A Pugh chart. marks: integers (criteria, concepts), plus marks positive. weights: one weight per criterion."""

    title: str
    concepts: tuple[str, ...]
    criteria: tuple[str, ...]
    marks: IntArray
    weights: Array

    @property
    def scores(self) -> Array:
        """Score of each concept: weighted sum of its plus marks minus its minus marks."""
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
        """Concepts from best to worst score; concepts with equal scores keep the order of the chart."""
        return tuple(self.concepts[i] for i in np.argsort(-self.scores, kind="stable"))


def read_mark(text: str, where: str) -> int:
    """Return the value of a mark of a Pugh chart: "0" is 0, "+" is 1, "++" is 2, "-" is -1."""
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
    """Build a Pugh chart from marks {criterion: [one mark per concept]}; the weight of a criterion is 1 unless given.

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


def pugh_study(path: Path | None = None, seed: int = 0) -> Study:
    """Score and rank the concepts of every [[chart]] of the TOML file, by default Tables 2.6 and 2.12 of the thesis."""
    charts = _charts(path or DATA / "pugh.toml")
    return Study(
        [
            Table(
                chart.title,
                ("Concept", "Plus", "Minus", "Score", "Rank"),
                [
                    (name, int(plus), int(minus), float(score), chart.ranking.index(name) + 1)
                    for name, plus, minus, score in zip(
                        chart.concepts, chart.pluses, chart.minuses, chart.scores, strict=True
                    )
                ],
            )
            for chart in charts
        ],
        {
            "charts": [
                {
                    "title": chart.title,
                    "scores": dict(zip(chart.concepts, chart.scores.tolist(), strict=True)),
                    "ranking": chart.ranking,
                }
                for chart in charts
            ]
        },
        {f"pugh_{i}.png": pugh_figure(chart) for i, chart in enumerate(charts, 1)},
    )


class _Chart(msgspec.Struct, forbid_unknown_fields=True):
    """A Pugh chart in the TOML file. marks: {criterion: one mark per concept}."""

    concepts: list[str]
    marks: dict[str, list[str | int]]
    weights: dict[str, float] = {}
    title: str = ""


def _charts(path: Path) -> list[PughChart]:
    try:
        charts = msgspec.convert(read_toml(path).get("chart", []), list[_Chart])
    except msgspec.ValidationError as error:
        raise InputError(f"{path.name}: {str(error).replace('$', 'chart')}") from None
    if not charts:
        raise InputError(f"{path.name}: no [[chart]], expected title, concepts and [chart.marks]")
    return [pugh_chart(c.title or f"chart {k}", c.concepts, c.marks, c.weights) for k, c in enumerate(charts, 1)]


def pugh_figure(chart: PughChart) -> Figure:
    """Plot the marks of every criterion of a Pugh chart, and the scores of the concepts."""
    height = 1.6 + 0.27 * len(chart.criteria)
    figure = Figure(figsize=(2.6 + 1.0 * len(chart.concepts), height), layout="constrained")
    ax = figure.add_subplot()
    bound = max(1, int(np.abs(chart.marks).max()))
    ax.imshow(chart.marks, cmap="RdYlGn", vmin=-bound, vmax=bound, aspect="auto", alpha=0.7)
    for (row, column), mark in np.ndenumerate(chart.marks):
        ax.text(column, row, "+" * mark or "-" * -mark or "0", ha="center", va="center")
    heads = [f"{name}\n{score:g}" for name, score in zip(chart.concepts, chart.scores, strict=True)]
    ax.set_xticks(range(len(heads)), heads, rotation=30, ha="left")
    ax.xaxis.tick_top()
    ax.set_yticks(range(len(chart.criteria)), list(chart.criteria))
    ax.set_title(chart.title)
    return figure
