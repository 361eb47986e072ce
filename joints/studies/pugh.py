"""`gpmodel joint pugh`: Pugh charts from a TOML table of marks."""

from pathlib import Path

import msgspec

from gpmodel.errors import InputError
from joints import figures
from joints.pugh import PughChart, pugh_chart
from joints.settings import DATA, read_toml
from joints.studies.study import Study, Table


def pugh_study(path: Path | None = None, seed: int = 0) -> Study:
    """Score and rank every [[chart]] of the TOML file, by default Tables 2.6 and 2.12 of the thesis."""
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
        {f"pugh_{i}.png": figures.pugh(chart) for i, chart in enumerate(charts, 1)},
    )


class _Chart(msgspec.Struct, forbid_unknown_fields=True):
    """A [[chart]] of the TOML file. marks: criterion -> one mark per concept."""

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
