"""Write the file report.json from a Report, and read it with checks of every type and bound."""

import dataclasses
from pathlib import Path

import msgspec

from gpmodel import files
from gpmodel.application.model_reader import REPORT
from gpmodel.errors import InputError
from gpmodel.evolution.input_histogram import without_runs
from gpmodel.report.schema import SCHEMA, Report
from gpmodel.texts import parse_json, read_limited

NAME = REPORT
LARGEST_FILE = 256 << 20
"""Largest size of report.json, bytes; a report of 200 000 poses has 130 MB."""
REPRESENTATIONS = ("linear", "tree")
"""Representations of evolved programs whose counts of inputs are always in report.json."""
EXPECTED = "expected the JSON that discover or calibrate wrote"


def as_dict(report: Report) -> dict[str, object]:
    """Return the content of report.json. The entry `histogram` counts inputs of round 1, by `linear` and `tree`."""
    content = dataclasses.asdict(report)
    first = report.histograms[0] if report.histograms else without_runs((), 1.0)
    none = (0,) * len(first.inputs)
    counts = {name: first.counts.get(name, none) for name in REPRESENTATIONS}
    significant = {"p_values": first.p_values, "significant": first.significant}
    shown = {"inputs": first.inputs, **counts, "shuffled": first.referring_by_chance, **significant}
    return content | {"histogram": shown}


def to_json(report: Report) -> str:
    """Return the text of the file report.json."""
    return files.to_json(as_dict(report))


def from_json(text: str | bytes, source: str = NAME) -> Report:
    """Return the Report from the text of report.json; unknown keys are ignored.

    Raises InputError with the location in the file for text that is not JSON, another schema, or a value of the wrong
    type or out of bounds.
    """
    try:
        header = parse_json(text)
    except ValueError as error:
        raise InputError(f"{source}: cannot be read ({error}); {EXPECTED}") from None
    if not isinstance(header, dict) or not isinstance(header.get("ladder"), list):
        raise InputError(f"{source}: has no 'ladder'; {EXPECTED}")
    if header.get("schema") != SCHEMA:
        again = f"make it again: {command}" if (command := header.get("command")) else "make it again"
        raise InputError(f"{source}: schema {header.get('schema')!r}; this version reads {SCHEMA}; {again}")
    try:
        return msgspec.convert(header, Report)
    except msgspec.ValidationError as error:
        raise InputError(f"{source}: {error}; {EXPECTED}") from None


def read_report(folder: Path) -> Report:
    """Return the saved Report in `folder`. Raises InputError for a missing or unreadable report.json."""
    path = folder / NAME
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one that discover or calibrate wrote with --out")
    if not path.exists():
        raise InputError(f"{folder}: has no {NAME}; expected a folder that discover or calibrate wrote")
    return from_json(read_limited(path, LARGEST_FILE, EXPECTED.removeprefix("expected ")), str(path))
