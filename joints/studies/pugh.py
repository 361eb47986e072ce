"""`gpmodel joint pugh`: concepts scored against a baseline by plus and minus marks (thesis Tables 2.6 and 2.12)."""

from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError, choices
from joints.settings import DATA, read_toml
from joints.studies.study import Study, Table


class PughChart(msgspec.Struct, forbid_unknown_fields=True):
    """A Pugh chart of scored concepts, from TOML. marks: {criterion: one mark per concept}, integers once read.
    weights: weight of each criterion, 1 by default.

    Raises InputError for a row of wrong length, an invalid mark, or a weight of an unknown criterion.
    """

    concepts: list[str]
    marks: dict[str, list[str | int]]
    weights: dict[str, float] = {}
    title: str = ""

    def __post_init__(self) -> None:
        where = f"Pugh chart '{self.title}'"
        if not self.concepts or not self.marks:
            raise InputError(f"{where}: no concepts or no criteria, expected at least one of each")
        for criterion, row in self.marks.items():
            if len(row) != len(self.concepts):
                raise InputError(
                    f"{where}, {criterion}: {len(row)} marks, expected {len(self.concepts)}, one per concept"
                )
            self.marks[criterion] = [read_mark(str(mark), f"{where}, {criterion}") for mark in row]
        if unknown := [name for name in self.weights if name not in self.marks]:
            known = choices(unknown[0], self.marks)
            raise InputError(f"{where}: unknown criterion '{unknown[0]}', expected one of {known}")

    @property
    def grid(self) -> IntArray:
        """Marks of a Pugh chart (criteria, concepts) as integers, plus marks positive."""
        return np.array(list(self.marks.values()), int)

    @property
    def scores(self) -> Array:
        """Score of each concept: weighted sum of its plus marks minus its minus marks."""
        return np.array([float(self.weights.get(name, 1.0)) for name in self.marks]) @ self.grid

    @property
    def pluses(self) -> IntArray:
        """Number of plus marks of each concept in a Pugh chart; "++" counts as two."""
        return np.asarray(np.maximum(self.grid, 0).sum(axis=0))

    @property
    def minuses(self) -> IntArray:
        """Number of minus marks of each concept in a Pugh chart."""
        return np.asarray(np.maximum(-self.grid, 0).sum(axis=0))

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


def _charts(path: Path) -> list[PughChart]:
    try:
        charts = msgspec.convert(read_toml(path).get("chart", []), list[PughChart])
    except msgspec.ValidationError as error:
        raise InputError(f"{path.name}: {str(error).replace('$', 'chart')}") from None
    if not charts:
        raise InputError(f"{path.name}: no [[chart]], expected title, concepts and [chart.marks]")
    for number, chart in enumerate(charts, 1):
        chart.title = chart.title or f"chart {number}"
    return charts


def pugh_figure(chart: PughChart) -> Figure:
    """Plot the marks of every criterion of a Pugh chart, and the scores of the concepts."""
    height = 1.6 + 0.27 * len(chart.marks)
    figure = Figure(figsize=(2.6 + 1.0 * len(chart.concepts), height), layout="constrained")
    ax = figure.add_subplot()
    bound = max(1, int(np.abs(chart.grid).max()))
    ax.imshow(chart.grid, cmap="RdYlGn", vmin=-bound, vmax=bound, aspect="auto", alpha=0.7)
    for (row, column), mark in np.ndenumerate(chart.grid):
        ax.text(column, row, "+" * mark or "-" * -mark or "0", ha="center", va="center")
    heads = [f"{name}\n{score:g}" for name, score in zip(chart.concepts, chart.scores, strict=True)]
    ax.set_xticks(range(len(heads)), heads, rotation=30, ha="left")
    ax.xaxis.tick_top()
    ax.set_yticks(range(len(chart.marks)), list(chart.marks))
    ax.set_title(chart.title)
    return figure
