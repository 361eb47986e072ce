"""The certificate of a calibration: machine, measurement, and accuracy before and after."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel import wording
from gpmodel.arrays import Array
from gpmodel.numerics.interval import coverage_factor
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report import words
from gpmodel.report.origin import REPEATS, Particulars
from gpmodel.report.page import render
from gpmodel.report.picture import AFTER, AFTER_LIGHT, BEFORE, INK, MUTED, Picture, numbers
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import STANDARD, ParameterRecord, Report
from gpmodel.report.schema_search import EffectRecord, Repeatability
from gpmodel.report.verdict import farthest_tool_point
from gpmodel.wording import NAME, millimetres

if TYPE_CHECKING:
    from matplotlib.axes import Axes


BINS, MOST_BINS = 12, 96
"""Numbers of histogram bars: up to the largest error after calibration, and at most up to the largest of all errors.
Half as many bars hide the shape of the error distribution."""

Heads = tuple[str, bool]
"""Heading of errors before calibration in a certificate, and True if errors after calibration are predicted."""


def histogram(errors: Array, tolerance_mm: float | None, heads: Heads) -> Picture:
    """Return a picture with histograms of the errors before and after calibration, mm, over common bins."""
    worst = errors.max(axis=0)
    return Picture(
        "errors", "Error before and after", 5.2, 1.9,
        f"Histogram of {len(errors)} measured errors: {heads[0]} at most {worst[0]:.3f} mm, after {worst[1]:.3f} mm.",
        "", lambda figure: _draw(figure.subplots(), errors, tolerance_mm, heads),
    )  # fmt: skip


def bins_of(errors: Array, tolerance_mm: float | None) -> list[float]:
    """Return the edges of the bars of an error histogram, mm, up to the largest error or tolerance; the width of a bar
    suits the errors after calibration."""
    largest = max(float(errors.max()), tolerance_mm or 0.0, 1e-9) * 1.0001
    count = np.clip(np.ceil(BINS * largest / max(float(errors[:, 1].max()), 1e-9)), BINS, MOST_BINS)
    return [float(edge) for edge in np.linspace(0.0, largest, int(count) + 1)]


def _draw(axes: Axes, errors: Array, tolerance_mm: float | None, heads: Heads) -> None:
    from matplotlib.ticker import MaxNLocator

    bins = bins_of(errors, tolerance_mm)
    axes.hist(errors[:, 0], bins, histtype="step", color=BEFORE, lw=1.4, label=heads[0])
    after = "after, predicted" if heads[1] else "after"
    axes.hist(errors[:, 1], bins, color=AFTER_LIGHT, ec=AFTER, lw=0.6, label=after)
    if tolerance_mm is not None:
        axes.axvline(tolerance_mm, color=INK, lw=1.0, ls=(0, (3, 3)), label="tolerance")
    axes.set(xlim=(0.0, bins[-1]), xlabel="3-D error, mm", ylabel="measurements")
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
    axes.legend(loc="upper right", labelcolor=MUTED)


STATISTICS: tuple[tuple[str, Callable[[Array], float]], ...] = (
    ("mean", np.mean),
    ("mean + 3 s", lambda errors: errors.mean() + 3 * errors.std(ddof=1)),
    ("95 % of the poses within", partial(np.percentile, q=95)),
    ("largest", np.max),
    ("RMS", root_mean_square),
)
"""Statistics of 3-D errors over at least two poses, by name."""


def statistics(errors: Array) -> tuple[tuple[str, str, str], ...]:
    """Return the rows of the accuracy table from errors, mm: name, value before and after calibration."""
    before, after = errors.T
    return tuple((name, millimetres(float(of(before))), millimetres(float(of(after)))) for name, of in STATISTICS)


def errors_before_and_after(report: Report, every: bool = False) -> Array | None:
    """Return the errors at held-out poses, mm, or at fitted poses if none were held out; None for fewer than two
    poses.
    Before calibration, registration and tool are fitted with nominal geometry. every: True to include outliers."""
    first = report.ladder[0].step if report.ladder else ""
    steps = (pose_errors(report, (first, report.shipped))) if first else ()
    seen = [p for p in steps if p.heldout or not report.held]
    seen = [p for p in seen if (every or not p.outlier) and p.before is not None and p.after is not None]
    return np.array([(p.before, p.after) for p in seen], dtype=float) if len(seen) > 1 else None


Line = tuple[str, str]
Parameter = tuple[str, str, str, str]
"""Name, value, standard error σ and unit of a parameter."""
SMALL_PRINT = (
    "Accuracy in the manner of ISO 9283 (1998): distance between measured and predicted position of the tool point, "
    "one measurement a pose, at the stated poses. Mean, mean + 3 s and maximum are statistics of these distances. "
    "Registration only: registration and tool point are fitted, the geometry is nominal. After: error predicted by the "
    "model below for the machine as measured. For a measured accuracy, apply the corrections, measure again, and "
    "certify the result of gpmodel verify. Further poses: random poses within the measured ranges of the joints, "
    "including the noise of this instrument. Each bound holds separately (Monte Carlo over fitted numbers and noise, "
    "JCGM 101)."
)


@dataclass(frozen=True)
class Certificate:
    """Content of an accuracy certificate as text; empty fields of the certificate are filled in by hand.

    statistics: name, value before calibration, value after calibration.
    before: heading of the errors before calibration.
    predicted: True if the errors after calibration are predicted, not measured.
    errors: error of each pose before and after calibration, mm; no pose if unknown.
    """

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
    errors: Array
    tolerance_mm: float | None
    predicted: bool = True
    before: str = "registration only"
    small_print: str = SMALL_PRINT

    @property
    def answer(self) -> str:
        """The accuracy of the calibrated machine in one sentence; empty if unknown."""
        if len(self.errors) == 0:
            return ""
        before, after = (root_mean_square(errors) for errors in self.errors.T)
        after_, largest, before_ = (f"{millimetres(v)} mm" for v in (after, self.errors[:, 1].max(), before))
        said = "predicted" if self.predicted else "measured"
        return f"{after_} RMS {said}, {largest} at most; {before_} RMS {self.before}."

    @property
    def heads(self) -> tuple[str, str]:
        """Headings of the table columns with error statistics before and after calibration."""
        return f"{self.before}, mm", "after, predicted, mm" if self.predicted else "after, mm"


def certificate(report: Report, particulars: Particulars, tolerance_mm: float | None = None) -> Certificate:
    """Return the certificate of a calibration or a discovery. tolerance_mm: largest allowed error of a pose."""
    errors = errors_before_and_after(report)
    count, unit = report.data.heldout if report.held else report.data.train, report.data.unit
    return Certificate(
        title=f"Calibration certificate: {particulars.machine or report.mechanism.name}",
        particulars=particulars.lines(),
        scope=(
            *_scope(report),
            *_orientation(report),
            ("predictions", words.predicted(report)),
            ("tolerance", _judged(errors_before_and_after(report, every=True), tolerance_mm)),
        ),
        poses=f"{count} {unit}{_unseen(report)}",
        statistics=() if errors is None else (*statistics(errors), *_further(report)),
        repeatability=_repeatability(report),
        effects=() if report.shipped == STANDARD else _printed(report.effects),
        parameters=_printed(report.geometry(), in_list=True),
        placement=_printed(report.placement, in_list=True),
        record=_record(report),
        errors=np.zeros((0, 2)) if errors is None else errors,
        tolerance_mm=tolerance_mm,
        small_print=f"{SMALL_PRINT}{_of_readings(report)} Values are those of the model fitted to all poses; "
        f"{words.interval(report)}.",
    )


def _of_readings(report: Report) -> str:
    """State which other measurements than positions enter the certified errors; empty if none do."""
    others = [r for r in report.readings if r.name not in ("position", "orientation")]
    said = wording.listed([f"{r.rows} rows of {r.name}" for r in others])
    return f" Errors include {said}, in mm as in the fit." if others else ""


def _unseen(report: Report) -> str:
    """State on which poses and by which fit the certified errors were computed."""
    if report.data.folds:
        folds = report.data.folds
        return (
            f", each predicted by a calibration without this pose ({folds}-fold); the final fit uses all "
            f"{report.data.unit}"
        )
    if report.held:
        return " held out: not used by the calibration that predicts them; the final fit uses all poses"
    return " to which the model was fitted"


def html(found: Certificate, kicker: str) -> str:
    """Return the certificate as a page that prints to one or two sides of A4. kicker: name of the mechanism."""
    picture = (
        histogram(found.errors, found.tolerance_mm, (found.before, found.predicted)) if len(found.errors) else None
    )
    return render("certificate.html.j2", c=found, kicker=kicker, picture=picture)


def _judged(errors: Array | None, tolerance_mm: float | None) -> str:
    """State whether the errors after calibration are within the stated tolerance; empty without a tolerance."""
    if tolerance_mm is None or errors is None:
        return ""
    beyond, limit = int((errors[:, 1] > tolerance_mm).sum()), f"{wording.millimetres(tolerance_mm)} mm"
    said = f"fail: {beyond} of {len(errors)}" if beyond else f"pass: none of {len(errors)}"
    return f"{said} poses with a predicted error above {limit}"


def _scope(report: Report) -> tuple[Line, ...]:
    lines = [("model of the machine", report.mechanism.name), ("measured", report.data.counted)]
    points = numbers(report.plots.points_mm)
    if len(points):
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        box = ", ".join(wording.minus(f"{a} {lo:.0f} to {hi:.0f}") for a, lo, hi in zip("xyz", low, high, strict=True))
        lines.append(("workspace covered, mm", box))
    joints = [wording.minus(f"{r.input} {r.low:.1f} to {r.high:.1f} {r.unit}") for r in report.data.ranges]
    if joints:
        lines.append(("joints covered", ", ".join(joints)))
    if report.data.outliers:
        lines.append(("outliers", wording.left_out(report.data.outliers, report.data.poses)))
    return tuple(lines)


def _further(report: Report) -> tuple[tuple[str, str, str], ...]:
    """Return the bounds of position errors at further poses after calibration; empty if unknown."""
    found = report.further
    if found is None:
        return ()
    stated = (
        (f"RMS of {found.poses} further poses", found.rms), (f"95 % of {found.poses} further poses", found.within_95),
        (f"every one of {found.poses} further poses", found.largest),
    )  # fmt: skip
    sure = wording.percent(found.confidence)
    return tuple((f"{name}, at most ({sure})", wording.UNKNOWN, wording.millimetres(b.bound_mm)) for name, b in stated)


def _orientation(report: Report) -> Iterator[Line]:
    """Yield the orientation error at the poses of the certificate, if orientation was measured."""
    if report.orientation:
        before, after = (wording.significant(value, 3) for value in report.orientation)
        there = wording.turned(report.orientation[1], farthest_tool_point(report))
        yield "orientation, RMS", f"{before} mrad with registration only, {after} after{there}"


def _repeatability(report: Report) -> tuple[Line, ...]:
    """Return pose accuracy and repeatability by ISO 9283, or the reason why they are not stated."""
    found, accurate = report.repeatability, report.positioning
    floor = ("noise floor", words.noise_floor(report))
    if found is None:
        return (("AP and RP of ISO 9283", "not stated: no pose was measured three times"), floor)
    lines = list(repeated(found))
    if accurate is None:
        lines.append(("pose accuracy AP", "not stated: fewer than three poses were measured three times"))
    else:
        kind = "held out" if accurate.heldout else "fitted, each error as if the pose were left out"
        for when, mm, stderr in (
            ("registration only", accurate.before_mm, accurate.before_stderr_mm),
            ("after", accurate.after_mm, accurate.after_stderr_mm),
        ):
            said = _with_uncertainty(mm, stderr, accurate.poses - 1)
            lines.append((f"pose accuracy AP, {when}, mean", f"{said}, {accurate.poses} poses {kind}"))
        lines.append(("pose accuracy AP, after, worst pose", f"{wording.millimetres(accurate.after_max_mm)} mm"))
    return (*lines, floor)


def repeated(found: Repeatability) -> tuple[Line, ...]:
    """Return the lines of the certificate on pose repeatability."""
    mean = _with_uncertainty(found.rp_mean_mm, found.rp_stderr_mm, found.poses - 1)
    return (
        ("pose repeatability RP = l + 3 s, mean", mean),
        ("pose repeatability RP, worst pose", f"{wording.millimetres(found.rp_max_mm)} mm"),
        ("from", f"{found.measurements} measurements of {found.poses} poses; ISO 9283 requires {REPEATS} of each"),
    )


def _with_uncertainty(mm: float, stderr: float | None, freedom: int) -> str:
    """Return a length with its expanded uncertainty, by Student's t of `freedom` degrees of freedom."""
    said, factor = f"{wording.millimetres(mm)} mm", coverage_factor(freedom)
    return said if stderr is None else f"{said}, U = {wording.millimetres(factor * stderr)} mm (k = {factor:.2f})"


def _printed(entries: Sequence[EffectRecord | ParameterRecord], in_list: bool = False) -> tuple[Parameter, ...]:
    sizes = [(e.name, wording.measured(e.value, e.stderr, e.unit, in_list=in_list)) for e in entries]
    return tuple((name, v.value, v.deviation or wording.UNKNOWN, v.unit) for name, v in sizes)


def _record(report: Report) -> tuple[Line, ...]:
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    lines = (
        ("table", report.data.file), ("SHA-256", report.data.sha256), ("command", report.command),
        ("seed", str(report.seed)), ("versions", versions), ("fit", f"{report.status}: {report.reason}".strip(": ")),
    )  # fmt: skip
    return tuple((name, value) for name, value in lines if value)


def text(found: Certificate) -> str:
    """Return the certificate's scope, accuracy, repeatability and effects as text, without parameters."""
    blocks = (
        (found.title, list(_lines(found.particulars)) or ["    no particulars were given"]),
        ("Scope", list(_lines(found.scope))),
        ("Accuracy, mm", list(_accuracy(found))),
        ("Repeatability", list(_lines(found.repeatability))),
        ("Effects", list(_lines([(name, f"{v} ± {s} {unit}") for name, v, s, unit in found.effects]))),
    )
    return wording.titled(blocks)


def _accuracy(found: Certificate) -> Iterator[str]:
    if not found.statistics:
        return
    yield wording.wrapped(f"over {found.poses}")
    yield "    {:>57}{:>18}".format(*(head.removesuffix(", mm") for head in found.heads))
    yield from ("    {:<47}{:>10}{:>18}".format(*row) for row in found.statistics)


def _lines(entries: Sequence[Line]) -> Iterator[str]:
    """Yield the non-empty fields of a certificate as lines, each name with its value."""
    for name, value in entries:
        if value and len(name) > NAME:
            yield f"    {name}"
        if value:
            yield wording.wrapped(value, NAME + 6, f"    {'' if len(name) > NAME else name:<{NAME + 2}}")
