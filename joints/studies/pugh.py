"""`gpmodel joint pugh`: concept charts from a TOML table of marks."""

from pathlib import Path

from gpmodel.errors import InputError
from joints import figures
from joints.pugh import PughChart, pugh_chart
from joints.settings import DATA, read_toml
from joints.studies.study import Study, Table


def pugh_study(path: Path | None = None, seed: int = 0) -> Study:
    """Every [[chart]] of the TOML, or the thesis' Tables 2.6 and 2.12, scored and ranked."""
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


def _charts(path: Path) -> list[PughChart]:
    entries = read_toml(path).get("chart")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{path.name}: no [[chart]], expected title, concepts and [chart.marks]")
    charts = []
    for number, entry in enumerate(entries, 1):
        where = f"{path.name}: chart {number}"
        unknown = [key for key in entry if key not in ("title", "concepts", "marks", "weights")]
        if unknown:
            raise InputError(f"{where}: unknown key '{unknown[0]}', expected title, concepts, marks, weights")
        marks, weights = entry.get("marks"), entry.get("weights", {})
        concepts = entry.get("concepts")
        if not (isinstance(concepts, list) and all(isinstance(name, str) for name in concepts)):
            raise InputError(f"{where}: concepts = {concepts!r}, expected a list of names")
        if not (isinstance(marks, dict) and all(isinstance(row, list) for row in marks.values())):
            raise InputError(f"{where}: marks, expected a table with one list of marks a criterion")
        if not (isinstance(weights, dict) and all(isinstance(w, (int, float)) for w in weights.values())):
            raise InputError(f"{where}: weights, expected a table with one number a criterion")
        charts.append(pugh_chart(str(entry.get("title", f"chart {number}")), concepts, marks, weights))
    return charts
