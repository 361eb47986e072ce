"""report.html: one page that opens offline, made from a Report and drawings."""

import base64
import hashlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined

from gpmodel import wording
from gpmodel.report import charts_errors, charts_search, verdict, words
from gpmodel.report.picture import Picture
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import REGISTRATION, STANDARD, Report, StepRecord

PAGE = "report.html"
NAME = 80
"""Longest name of a candidate on the page, in characters."""
_INSIDE = re.compile(r"(?<=\d) (?=[→±%]|[nµmk]?(?:m|rad|N|px|deg)\b)|(?<=[→±]) ")
"""Spaces of a page title at which a line must not break."""
MOST_POSES = 400
"""Number of poses listed on the page, the largest error first; poses.csv lists all poses."""


def pictures(report: Report) -> Iterator[Picture]:
    """Yield every picture of the report page for which the report has data."""
    yield from charts_errors.pictures(report)
    yield from charts_search.pictures(report)


def html(report: Report, drawings: Mapping[str, str]) -> str:
    """Return the report page as HTML. drawings: inline SVG of the report's pictures by name, from `figures.drawn`."""
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
    """Return a page from a template, with the common formats and sentences."""
    return str(_environment().get_template(template).render(**content))


def drawing(picture: Picture) -> str:
    """Draw a picture; return inline SVG."""
    from gpmodel.report.figures import drawn

    return drawn([picture])[picture.name]


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
        words=words, measured=wording.measured, chance=wording.chance, drawing=drawing,
        script=script, script_hash=script_hash,
    )  # fmt: skip
    return environment


def sentence(text: str) -> str:
    """Write a text as a sentence, with a capital first letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""


def unbroken(text: str) -> str:
    """Put no-break spaces into a text between a number and its unit, and on both sides of `→` and `±`."""
    return _INSIDE.sub("\N{NO-BREAK SPACE}", text)


def _digits(values: Sequence[float | None]) -> int:
    """Return the number of decimals for a column of errors in mm: three digits of the median."""
    known = sorted(v for v in values if v)
    middle = known[len(known) // 2] if known else 1.0
    return max(3, 2 - math.floor(math.log10(middle)))


def _decimals(value: float | None, digits: int) -> str:
    return wording.UNKNOWN if value is None else f"{value:.{digits}f}"


@cache
def script(name: str) -> str:
    """Return the source text of a script that pages include."""
    return (files("gpmodel.report") / "templates" / name).read_text(encoding="utf-8")


def script_hash(name: str) -> str:
    """Return the hash that allows one script in the content security policy of a page."""
    digest = hashlib.sha256(script(name).encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def _tiles(report: Report) -> Iterator[dict[str, str]]:
    """Yield the key numbers of the main models: title, RMS error, note with the largest error, and kind."""
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
