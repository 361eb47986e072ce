"""Draws the report's pictures into files; the only place of this package that knows matplotlib."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from gpmodel.report import charts_errors, charts_findings, charts_search, charts_space, schema
from gpmodel.report.picture import INK, MUTED, RULE, Picture
from gpmodel.report.saved import as_dict

DOTS_PER_INCH = 192
STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "text.parse_math": False,
    "axes.labelcolor": MUTED,
    "axes.labelsize": 8.5,
    "axes.edgecolor": "#b9c0c9",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.8,
    "xtick.color": "#b9c0c9",
    "ytick.color": "#b9c0c9",
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.2,
    "figure.facecolor": "white",
}


def pictures(saved: schema.Report) -> Iterator[Picture]:
    """Every picture this report has the numbers for."""
    report = as_dict(saved)
    return chain.from_iterable(
        c.pictures(report) for c in (charts_errors, charts_space, charts_search, charts_findings)
    )


def write_figures(report: schema.Report, folder: Path) -> dict[str, Path]:
    """Draw `figures/NAME.png` in `folder` for every picture the report has numbers for; the files by name."""
    target = folder / "figures"
    target.mkdir(parents=True, exist_ok=True)
    files: dict[str, Path] = {}
    with rc_context(STYLE):
        for picture in pictures(report):
            figure = Figure(figsize=(picture.width, picture.height), dpi=DOTS_PER_INCH, layout="constrained")
            picture.draw(figure)
            files[picture.name] = target / f"{picture.name}.png"
            figure.savefig(files[picture.name], metadata={"Software": None, "Description": picture.alt})
    return files
