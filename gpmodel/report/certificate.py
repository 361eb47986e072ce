"""The certificate of a calibration: what machine, measured how, how accurate before and after; a page and a PDF."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel import wording
from gpmodel.report import words
from gpmodel.report.accuracy import Accuracy, before_and_after
from gpmodel.report.page import render
from gpmodel.report.particulars import Particulars
from gpmodel.report.picture import numbers
from gpmodel.report.schema import STANDARD, ParameterRecord, Report
from gpmodel.report.schema_search import EffectRecord

Line = tuple[str, str]
Parameter = tuple[str, str, str, str]
"""Name, value, σ and unit."""
STATISTICS = (
    ("mean", "mean"), ("mean + 3 s", "mean_3sd"), ("95 % of the poses within", "within_95"),
    ("largest", "largest"), ("RMS", "rms"),
)  # fmt: skip
SMALL_PRINT = (
    "Accuracy in the manner of ISO 9283 (1998): distance between measured and predicted position of the tool point, "
    "one measurement a pose, over the poses named; mean, mean + 3 s and maximum are of these distances. Before is "
    "registration and tool point alone, with the nominal geometry; after is the model below. The interval of the RMS "
    "holds for poses drawn like these. Values and σ are of the model fitted to all poses."
)


@dataclass(frozen=True)
class Certificate:
    """Everything the certificate prints, as text. statistics: name, before, after."""

    title: str
    particulars: tuple[Line, ...]
    scope: tuple[Line, ...]
    poses: str
    statistics: tuple[tuple[str, str, str], ...]
    repeatability: tuple[Line, ...]
    effects: tuple[Parameter, ...]
    parameters: tuple[Parameter, ...]
    placement: tuple[Parameter, ...]
    record: tuple[Line, ...]


def certificate(report: Report, particulars: Particulars) -> Certificate:
    """The certificate of a calibration or a discovery."""
    found = before_and_after(report)
    count = report.data.heldout if report.held else report.data.train
    kind = "held out: no step of the calibration saw them" if report.held else "the poses the model was fitted to"
    return Certificate(
        title=f"Calibration certificate: {particulars.machine or report.mechanism.name}",
        particulars=particulars.lines(),
        scope=_scope(report),
        poses=f"{count} poses {kind}" if report.held else f"{count} poses, {kind}",
        statistics=() if found is None else _statistics(*found),
        repeatability=_repeatability(report),
        effects=() if report.shipped == STANDARD else _printed(report.effects),
        parameters=_printed(report.geometry()),
        placement=_printed(report.placement),
        record=_record(report),
    )


def html(report: Report, particulars: Particulars) -> str:
    """The certificate as a page that prints to one or two sides of A4."""
    return render("certificate.html.j2", c=certificate(report, particulars), report=report, small_print=SMALL_PRINT)


def _scope(report: Report) -> tuple[Line, ...]:
    lines = [("model of the machine", report.mechanism.name), ("measured poses", f"{report.data.poses}")]
    points = numbers(report.plots.points_mm)
    if len(points):
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        box = ", ".join(wording.minus(f"{a} {lo:.0f} to {hi:.0f}") for a, lo, hi in zip("xyz", low, high, strict=True))
        lines.append(("workspace covered, mm", box))
    joints = [wording.minus(f"{r.input} {r.low:.1f} to {r.high:.1f} {r.unit}") for r in report.data.ranges]
    if joints:
        lines.append(("joints covered", ", ".join(joints)))
    if report.data.outliers:
        lines.append(("left out of the fit, by row", ", ".join(map(str, report.data.outliers))))
    return tuple(lines)


def _statistics(before: Accuracy, after: Accuracy) -> tuple[tuple[str, str, str], ...]:
    rows = [(title, *(wording.millimetres(getattr(a, name)) for a in (before, after))) for title, name in STATISTICS]
    spans = (f"{wording.millimetres(a.low)} to {wording.millimetres(a.high)}" for a in (before, after))
    first, second = spans
    return (*((t, b, a) for t, b, a in rows), ("95 % interval of the RMS", first, second))


def _repeatability(report: Report) -> tuple[Line, ...]:
    found = report.repeatability
    if found is None:
        return (("repeatability", "not measured: no pose was measured three times"),
                ("noise floor", words.noise_floor(report)))  # fmt: skip
    return (
        ("pose repeatability RP = l + 3 s, mean", f"{wording.millimetres(found.rp_mean_mm)} mm"),
        ("pose repeatability RP, worst pose", f"{wording.millimetres(found.rp_max_mm)} mm"),
        ("from", f"{found.measurements} measurements of {found.poses} poses"),
        ("noise floor", words.noise_floor(report)),
    )


def _printed(entries: Sequence[EffectRecord | ParameterRecord]) -> tuple[Parameter, ...]:
    sizes = [(e.name, wording.measured(e.value, e.stderr, e.unit)) for e in entries]
    return tuple((name, v.value, v.deviation or wording.UNKNOWN, v.unit) for name, v in sizes)


def _record(report: Report) -> tuple[Line, ...]:
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    lines = (
        ("table", report.data.file), ("SHA-256", report.data.sha256), ("command", report.command),
        ("seed", str(report.seed)), ("versions", versions), ("fit", f"{report.status}: {report.reason}".strip(": ")),
    )  # fmt: skip
    return tuple((name, value) for name, value in lines if value)
