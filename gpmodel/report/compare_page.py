"""compare.html: what changed between two calibrations, as a page."""

from gpmodel.report.charts_compare import picture
from gpmodel.report.compare import SIDES, Comparison, cells, tables, verdict
from gpmodel.report.figures import drawn
from gpmodel.report.page import render


def html(found: Comparison) -> str:
    """The comparison as a page."""
    chart = picture([c for _, changes in tables(found) for c in changes])
    return render(
        "compare.html.j2", found=found, verdict=verdict(found), cells=cells, tables=tables(found), sides=SIDES,
        picture=chart, drawing=drawn([chart])[chart.name] if chart else "",
    )  # fmt: skip
