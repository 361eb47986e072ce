"""report.html: one page that opens offline, a pure function of a Report and its drawings."""

import base64
import hashlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined

from gpmodel import wording
from gpmodel.report import (
    charts_errors,
    charts_evolution,
    charts_findings,
    charts_search,
    charts_space,
    verdict,
    words,
)
from gpmodel.report.picture import Picture
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import REGISTRATION, STANDARD, Report, StepRecord

PAGE = "report.html"
NAME = 80
"""Longest name of a candidate on the page, in characters."""
_INSIDE = re.compile(r"(?<=\d) (?=[→±%]|[nµmk]?(?:m|rad|N|px|deg)\b)|(?<=[→±]) ")
"""Spaces at which a line of a title must not end."""
MOST_POSES = 400
"""Poses that the page lists, the largest error first; poses.csv has all."""


def pictures(report: Report) -> Iterator[Picture]:
    """Every picture this report has the numbers for."""
    for charts in (charts_errors, charts_space, charts_search, charts_evolution, charts_findings):
        yield from charts.pictures(report)


def html(report: Report, drawings: Mapping[str, str]) -> str:
    """The page's text. drawings: inline SVG of the report's pictures by name, as `figures.draw` makes them."""
    poses = pose_errors(report)
    return render(
        "report.html.j2",
        report=report,
        tiles=list(_tiles(report)),
        parameters=[p for p in report.parameters if p.kept],
        dropped=report.dropped(),
        pictures={p.name: p for p in pictures(report) if p.name in drawings},
        drawings=drawings,
        poses=poses[:MOST_POSES],
        digits=_digits([p.after for p in poses]),
        behind=verdict.behind(report),
        all_poses=len(poses),
    )


def render(template: str, **content: object) -> str:
    """A page from one of the templates, with the formats and sentences all of them use."""
    return str(_environment().get_template(template).render(**content))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("gpmodel.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        millimetres=wording.millimetres, distance=wording.length, percent=wording.percent, minus=wording.minus,
        expression=wording.expression, unit=wording.pretty_unit, sentence=sentence, decimals=_decimals,
        shortened=partial(wording.shortened, length=NAME), unbroken=unbroken,
    )  # fmt: skip
    environment.globals.update(
        words=words, measured=wording.measured,
        chance=wording.chance, script=script, script_hash=script_hash,
    )  # fmt: skip
    return environment


def sentence(text: str) -> str:
    """The text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""


def unbroken(text: str) -> str:
    """The text with no-break spaces between a number and its unit, and on both sides of `→` and `±`."""
    return _INSIDE.sub("\N{NO-BREAK SPACE}", text)


def _digits(values: Sequence[float | None]) -> int:
    """Decimals of a whole column of mm: three digits of its median."""
    known = sorted(v for v in values if v)
    middle = known[len(known) // 2] if known else 1.0
    return max(3, 2 - math.floor(math.log10(middle)))


def _decimals(value: float | None, digits: int) -> str:
    return wording.UNKNOWN if value is None else f"{value:.{digits}f}"


@cache
def script(name: str) -> str:
    """The text of one script of the templates."""
    return (files("gpmodel.report") / "templates" / name).read_text(encoding="utf-8")


def script_hash(name: str) -> str:
    """Compute the hash that allows this one script in the security policy of a page."""
    digest = hashlib.sha256(script(name).encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def _tiles(report: Report) -> Iterator[dict[str, str]]:
    """The numbers to remember: title, RMS, largest error and kind, of the steps that matter."""
    first, standard = report.step(REGISTRATION), report.step(STANDARD)
    last = report.ladder[-1] if report.ladder and report.ladder[-1].beyond_standard else None
    if first is not None:
        yield _tile("registration only", first, "start")
    if standard is not None:
        yield _tile("standard model", standard, "before" if last else "after")
    if last is not None:
        count = len(report.effects)
        found = "found" if report.kind == "discover" else "named"
        refused = report.shipped == STANDARD
        title = f"with {count} effect{'s' if count != 1 else ''} {found}{', not shipped' if refused else ''}"
        yield _tile(title, last, "before" if refused else "after")


def _tile(title: str, rung: StepRecord, kind: str) -> dict[str, str]:
    rms, largest = (wording.millimetres(mm) for mm in (rung.errors.rms_mm, rung.errors.max_mm))
    note = f"RMS {'held out' if rung.heldout.known else 'training'}, max {largest}"
    return {"title": title, "value": rms, "note": note, "kind": kind}
