"""Verification of a model on new measurements as text, as a page and as a certificate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel import wording
from gpmodel.application.named_changes import NamedChange
from gpmodel.application.possible_changes import SET_UP
from gpmodel.report.certificate import Certificate, Line, repeated, statistics
from gpmodel.report.origin import Particulars
from gpmodel.report.page import render
from gpmodel.report.picture import AFTER, AXIS, BEFORE, INK, MUTED, Picture, log_axis
from gpmodel.report.schema import ErrorsMm
from gpmodel.report.verification import TOO_GOOD, PoseRecord, Verification

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOST_ROWS, MOST_PRINTED = 400, 8
"""Number of verified rows listed on page and terminal, the largest error first; verify.csv has all rows."""
MOST_RIVALS = 4
"""Number of alternative explanations of a change in a sentence; verify.json lists all."""
SLIPPED = "tool slipped"
"""First words of the name of the change "slip of the tool"."""
UNLIKELY = 0.001
"""Probability of a row's error below which the row is marked: by chance in one of fifty tables of twenty rows."""
NOMINAL = "nominal, as driven"
"""Label of errors with nominal geometry at the actual joint values, which are not errors before calibration."""
LOST = 50.0
"""Error with nominal geometry, mm, that no arm of the right type has: joint columns, units or the type are wrong."""


def size(record: Verification, mm: float | None, bare: bool = False) -> str:
    """Return the error of a verified row as text in the unit of the measurements. bare: without the unit."""
    unit, of_one = record.shown
    if unit == "mm":
        said = wording.millimetres(mm)
    else:
        said = wording.UNKNOWN if mm is None else wording.significant(mm / of_one, 3)
    return said if bare else f"{said} {unit}"


def verdict(record: Verification) -> str:
    """Return the verdict of a verification (model holds or not) as one text."""
    return " ".join(sentences(record))


def sentences(record: Verification) -> Iterator[str]:
    """Yield verdict, errors for comparison, changes and tolerance of a verification, one sentence each."""
    after, promised, without = (
        size(record, mm) for mm in (record.after.rms_mm, record.promised_mm, record.without.rms_mm)
    )
    lasting = [found for found in record.changes if found.of_the_machine]
    only_tool = record.explained and lasting and all(f.kind == "tool" or f.name.startswith(SLIPPED) for f in lasting)
    drifted = "The tool or its load has changed, not the machine" if only_tool else "The machine has drifted"
    drifted = drifted if lasting else "The model does not hold"
    answer = {"holds": "The model holds", "drifted": drifted}.get(
        record.verdict, "This is another machine, or many parts of the machine have changed"
    )
    yield " ".join([*_rows_apart(record), f"{answer}: {after} RMS on {record.data.counted} measured afterwards."])
    yield f"Expected: {promised}. Nominal geometry at the driven joint values: {without}."
    for found in record.changes:
        yield f"{_what(found)}: {change(found)}."
        if found.rows:
            yield "The other rows do not have this change."
    if any(found.of_the_model for found in record.changes):
        yield (
            "The poses of the fit do not exclude these errors of the model, so that they show no change of the "
            "machine; fit a model to both tables."
        )
    if lasting and record.explained:
        explains = "This change explains" if len(lasting) == 1 else "These changes explain"
        yield f"{explains} the error; nothing else has changed."
    if record.verdict == "drifted" and not record.changes:
        noise = wording.significant(math.sqrt(record.chi_square / record.degrees), 2)
        yield f"No single change explains it; a noise of the measurement {noise} times that of the fit does."
    if record.verdict == "another machine" and (record.without.rms_mm or 0.0) > LOST:
        yield (
            "The nominal geometry does not fit either: check the units, the order of the joints and the type "
            "of machine."
        )
    yield from filter(None, [tolerance(record)])


def _what(found: NamedChange) -> str:
    """Return the first words of a sentence on a change: set-up, machine, or an error of the model."""
    if found.kind == SET_UP:
        return "Set-up or instrument changed, not the machine"
    return "Error of the model, no change" if found.of_the_model else "Changed"


def _rows_apart(record: Verification) -> Iterator[str]:
    """Yield remarks on rows excluded from the verdict, and on errors that are too small."""
    if record.fitted:
        several = "s" if len(record.fitted) > 1 else ""
        yield f"{len(record.fitted)} row{several} of the fit left out ({wording.some(record.fitted)})."
    if rows := record.data.outliers:
        worst = max((p.with_mm or 0.0 for p in record.poses if p.outlier), default=0.0)
        yield f"{wording.left_out(rows, len(record.poses))}: up to {size(record, worst)} off."
    if record.chance_of_less < TOO_GOOD:
        yield (
            f"The errors are smaller than the noise of the model allows (chi-square {record.chi_square:.3g} of "
            f"{record.degrees}): was another instrument used, or were the positions computed?"
        )


def tolerance(record: Verification) -> str:
    """State whether the errors of the new measurements are within the tolerance; empty without a tolerance."""
    if record.tolerance_mm is None:
        return ""
    (row, worst), (unit, of_one) = record.worst, record.shown
    limit = f"{record.tolerance_mm / of_one:.4g} {unit}"
    if not record.beyond:
        return f"Every {record.data.unit.rstrip('s')} is within {limit}. The largest error is {size(record, worst)}."
    count = len(record.poses) + (len(record.others.rows) if record.others else 0)
    return (
        f"{record.beyond} of {count} {record.data.unit} are beyond {limit}. "
        f"The largest error, in row {row}, is {size(record, worst)}."
    )


def change(found: NamedChange) -> str:
    """Return a change with its size and its alternatives: `tool point moved by 31.0 ± 4.1 µm; may instead be J6 Tx`."""
    instead = f"; may instead be {', or '.join(found.rivals[:MOST_RIVALS])}" if found.rivals else ""
    if len(found.rivals) > MOST_RIVALS:
        instead += f", or {len(found.rivals) - MOST_RIVALS} others"
    if found.kind in ("size", "growth"):
        more, by, off = ("more" if found.value > 0 else "less"), 100 * abs(found.value), 100 * found.stderr
        digits = max(0, -math.floor(math.log10(off))) if off > 0 else 1
        before = "in the other rows" if found.rows else "before"
        return f"{found.name}: {by:.{digits}f} % ± {off:.{digits}f} % {more} than {before}{instead}"
    moved = " changed" if found.unit == "kg" else " moved" if found.kind in ("zero", "tool") else ""
    moved = " differs" if found.rows else moved
    return f"{found.name}{moved} by {wording.measured(found.value, found.stderr, found.unit)}{instead}"


def facts(record: Verification) -> Iterator[tuple[str, str]]:
    """Yield the statistics behind the verdict of a verification, each with its heading."""
    known = "" if record.noise_degrees is None else f", σ known from {record.noise_degrees:.0f}"
    yield (
        "chi-square", f"{record.chi_square:.1f} of {record.degrees} degrees of freedom{known}; "
        f"probability {wording.chance(record.chance)} if the model holds",
    )  # fmt: skip
    if record.rows > len(record.poses):
        yield "judged on", f"{len(record.poses)} of {record.rows} rows, in equally spaced blocks"
    for kind in record.kinds:
        with_model, promised, without = (
            wording.UNKNOWN if v is None else wording.significant(v, 3)
            for v in (kind.after, kind.promised, kind.without)
        )
        yield (
            f"{kind.name}, {kind.rows} rows",
            f"{with_model} {kind.unit} RMS, {promised} expected, {without} by nominal geometry",
        )
    if (turns := record.orientation) is not None:
        sizes = [wording.significant(v, 3) for v in (turns.after or 0.0, turns.before or 0.0)]
        there = wording.turned(turns.after or 0.0, record.lever_m)
        yield (
            f"orientation, {turns.rows} rows",
            f"{sizes[1]} mrad RMS by nominal geometry, {sizes[0]} by the model{there}",
        )
    for found in record.changes:
        heading = "error of the model" if found.of_the_model else "changed"
        yield heading, f"{change(found)}; chance {wording.chance(found.chance)}"
    if record.missed.known:
        yield "errors at the compensated targets", _errors(record, record.missed)
    if record.instrument is not None:
        there = "also in these measurements" if record.instrument else "not in these measurements, and left out"
        yield "instrument's errors", there
    if record.data.outliers:
        yield "outliers", wording.left_out(record.data.outliers, len(record.poses))
    beyond = [p.row for p in record.poses if p.outside]
    if beyond:
        yield "outside the model's ranges", f"rows {wording.some(beyond)}"
    if record.repeatability is not None:
        yield "pose repeatability RP, mean", f"{wording.millimetres(record.repeatability.rp_mean_mm)} mm"
    yield "detectable zero shift", ", ".join(_visible(record))


def _visible(record: Verification) -> Iterator[str]:
    for zero in record.visible:
        seen = "none (registration or tool absorb it)" if zero.size is None else None
        yield f"{zero.joint} {seen or wording.measured(zero.size, None, zero.unit)}"


def _errors(record: Verification, errors: ErrorsMm) -> str:
    mean, rms, most = (size(record, mm, bare=True) for mm in (errors.mean_mm, errors.rms_mm, errors.max_mm))
    return f"mean {mean}, RMS {rms}, largest {most} {record.shown[0]}"


def text(record: Verification) -> str:
    """Return a verification as text of 80 columns: verdict, errors, statistics and rows with the largest errors."""
    errors = (
        (NOMINAL, _errors(record, record.without)), ("with the model", _errors(record, record.after)),
        ("expected", f"RMS {size(record, record.promised_mm)}"),
    )  # fmt: skip
    heads = f"    {'row':>6}{'nominal':>10}{'model':>9}{'expected':>10}{'chance':>12}   {record.shown[0]}"
    blocks = (
        ("Verdict", [wording.wrapped(said) for said in sentences(record)]),
        ("Errors", [f"    {title:<19}{said}" for title, said in errors]),
        ("Evidence", [wording.wrapped(f"{name}: {value}", 6, "    ") for name, value in facts(record)]),
        ("Worst rows", [heads, *(_row(record, p) for p in record.worst_first[:MOST_PRINTED])]),
    )
    return wording.titled(blocks)


def _row(record: Verification, pose: PoseRecord) -> str:
    errors = (size(record, mm, bare=True) for mm in (pose.without_mm, pose.with_mm, pose.promised_mm))
    said = "outlier" if pose.outlier else wording.chance(pose.chance)
    mark = " *" if pose.chance is not None and pose.chance < UNLIKELY else ""
    cells = "{:>10}{:>9}{:>10}".format(*errors) + f"{said:>12}{mark}"
    return f"    {pose.row:>6}{cells}{f'  outside {pose.outside}' if pose.outside else ''}"


def picture(record: Verification) -> Picture:
    """Return a picture of verification errors row by row: with the model, with nominal geometry, and expected."""
    return Picture(
        "verification", "Error of every pose", 7.6, 3.0,
        f"Error of every row: {_errors(record, record.after)} with the model, "
        f"{_errors(record, record.without)} with nominal geometry at the driven joint values.",
        "Dots: error of each row with the model (blue) and with nominal geometry at the driven joint values (grey). "
        "Marks: twice the RMS error that the model expects. The scale is logarithmic.",
        partial(_draw, record=record),
    )  # fmt: skip


def _draw(figure: Figure, record: Verification) -> None:
    from matplotlib.ticker import MaxNLocator

    axes = figure.subplots()
    rows, nan, (unit, of_one) = [p.row for p in record.poses], float("nan"), record.shown

    def of(name: str) -> list[float]:
        return [nan if (v := getattr(p, name)) is None else max(v, 1e-5) / of_one for p in record.poses]

    values = np.array([of("with_mm"), of("without_mm"), of("promised_mm")])
    log_axis(axes, 0.5 * float(np.nanmin(values)), 2.0 * float(np.nanmax(values)), "y")
    axes.plot(rows, of("without_mm"), "o", ms=3.5, color=BEFORE, label="nominal geometry")
    axes.plot(rows, of("with_mm"), "o", ms=4.5, color=AFTER, label="model")
    axes.plot(rows, [2 * v for v in of("promised_mm")], "_", ms=7, color=INK, label="expected, 2 RMS")
    if record.tolerance_mm:
        axes.axhline(record.tolerance_mm / of_one, color=AXIS, lw=1.0)
        axes.text(rows[0], record.tolerance_mm / of_one, "tolerance", color=MUTED, size=8, va="bottom")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("row")
    axes.set_ylabel(f"error, {unit}" if record.kinds else "3-D error, mm")
    axes.grid(axis="y")
    figure.legend(loc="outside upper right", ncols=3)


def html(record: Verification) -> str:
    """Return the verification of a model as an HTML page."""
    answer, _, *rest = sentences(record)  # the tiles show the errors of the second sentence
    return render(
        "verify.html.j2", record=record, answer=answer, rest=rest, facts=list(facts(record)), picture=picture(record),
        rows=record.worst_first[:MOST_ROWS], unlikely=UNLIKELY, size=partial(size, record),
    )  # fmt: skip


SMALL_PRINT = (
    "Accuracy in the manner of ISO 9283 (1998): distance between measured and predicted position of the tool point "
    "for the rows of a table that was measured after the fit of the model. Mean, mean + 3 s and maximum are statistics "
    "of these distances. Nominal: nominal geometry at the driven joint values, with fitted registration "
    "and tool point; "
    "this is not the machine before the calibration. After: the model, with a newly fitted registration."
)
OF_READINGS = (
    "Errors are those of the measured quantities in mm: distance of a touch from the surface or point, error of the "
    "length of a bar. Pixels and degrees are converted to mm as in the fit of the model. ISO 9283 "
    "requires measurements "
    "of the tool point, which this table does not have. Nominal: nominal geometry at the driven joint values. After: "
    "the model."
)


def certificate(record: Verification, particulars: Particulars) -> Certificate:
    """Return the certificate of a verification; the errors before and after are measured errors."""
    pairs = [(p.without_mm, p.with_mm) for p in record.poses if not p.outlier and None not in (p.without_mm, p.with_mm)]
    errors = np.array(pairs, dtype=float).reshape(-1, 2)
    return Certificate(
        title=f"Verification certificate: {particulars.machine or record.mechanism.name}",
        particulars=particulars.lines(),
        scope=tuple(_scope(record)),
        poses=f"{len(pairs)} {record.data.unit}, measured after the model was fitted",
        statistics=statistics(errors) if len(pairs) > 1 else (),
        repeatability=() if record.repeatability is None else repeated(record.repeatability),
        effects=(),
        parameters=(),
        placement=(),
        record=tuple(_record(record)),
        errors=errors,
        tolerance_mm=record.tolerance_mm,
        predicted=False,
        before=NOMINAL,
        small_print=OF_READINGS if record.kinds else SMALL_PRINT,
    )


def _scope(record: Verification) -> Iterator[Line]:
    yield "result", verdict(record)
    judged = "" if record.tolerance_mm is None else f"{'fail' if record.beyond else 'pass'}: "
    yield "tolerance", f"{judged}{tolerance(record)}"
    yield from facts(record)
    yield "model of the machine", record.mechanism.name
    yield "measured", record.data.counted
    yield "noise of one coordinate", f"{wording.millimetres(record.sigma_mm)} mm, by the model"


def _record(record: Verification) -> Iterator[Line]:
    versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
    lines = (
        ("table", record.data.file), ("SHA-256", record.data.sha256), ("model", record.model_file),
        ("SHA-256 of the model", record.model_sha256), ("command", record.command), ("versions", versions),
    )  # fmt: skip
    for name, value in lines:
        if value:
            yield name, value
