"""Write all files of a report to a folder."""

from collections.abc import Mapping
from pathlib import Path

from gpmodel.files import write_text
from gpmodel.report import explore, page, poses, saved
from gpmodel.report.schema import Report


def write_report(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write report.json, report.html, explore.html, poses.csv and figures/ into `folder`; return the file paths."""
    from gpmodel.report.figures import drawn

    return write_pages(report, drawn(page.pictures(report), folder), folder)


def write_pages(report: Report, drawings: Mapping[str, str], folder: Path) -> tuple[Path, ...]:
    """Write the pages of a report into a folder with pictures in figures/. drawings: SVG of every picture by name."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {page.PAGE: page.html(report, drawings), saved.NAME: saved.to_json(report), poses.CSV: poses.csv(report)}
    if explore.drawable(report):
        texts[explore.PAGE] = explore.html(report)
    for name, text in texts.items():
        write_text(folder / name, text)
    return tuple(folder / name for name in texts)
