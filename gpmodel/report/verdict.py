"""Write the one-sentence verdict of a report, and the sentences after the verdict."""

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from gpmodel import wording
from gpmodel.errors import LISTED
from gpmodel.hierarchy.further import PRIOR
from gpmodel.model.memory import read_by
from gpmodel.report import words
from gpmodel.report.schema import STANDARD, Report

COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
MOST_SIZED = 2
"""Largest number of effects that the verdict of a calibration names; further effects are counted."""
SURE = 0.9
"""Probability of a found effect above which the verdict names no other possible cause."""
STATED_TOO_LARGE = 3.0
"""Ratio of stated noise to residual above which the report remarks that the stated noise is too large."""
FAR_ABOVE = 2.0
"""Ratio of held-out to training error from which it is remarked. Fitting 27 unknowns to 30 poses causes 1.4."""
_LOAD = re.compile(r"(?:payload_)?(?:torque|moment|force)_(?P<at>\w+)$")


def of_discovery(report: Report) -> str:
    """State the number of missing effects, their confirmation on held-out poses, and errors without and with them."""
    standard, last = report.step(STANDARD) or report.ladder[0], report.ladder[-1]
    before, after = standard.errors.rms_mm, last.errors.rms_mm
    if not report.effects:
        left = f"{wording.length(before)} RMS on {_where(report)}{_beside_noise(report, before)}"
        return f"Nothing was added: no further effect is significant at these poses, {left}.{_remarks(report)}"
    effects = f"{_count(len(report.effects))} effect{'s' if len(report.effects) > 1 else ''}"
    were = "were" if len(report.effects) > 1 else "was"
    if report.confirmation is not None and not report.confirmation.passed:
        return (
            f"{effects} {were} found but not confirmed on {_where(report)}: the standard model is kept, "
            f"{wording.length(before)}{_beside_noise(report, before)}."
        ).capitalize() + _remarks(report)
    confirmed = f" and {'are' if len(report.effects) > 1 else 'is'} confirmed" if report.confirmation else ""
    change = f"{_change(report)} on {_where(report)}{_beside_noise(report, after)}"
    return f"{effects.capitalize()} {were} missing{confirmed}: {change}.{_remarks(report)}"


def _change(report: Report) -> str:
    """Return name and error of the earlier model, and the error of the final one: `standard model 0.148 → 0.036 mm`."""
    before, after = (report.step(name) for name in report.before_and_after())
    if before is None or after is None or before is after:
        return f"{wording.length(report.ladder[-1].errors.rms_mm)} RMS"
    return f"{report.title(before)} {wording.change(before.errors.rms_mm, after.errors.rms_mm)}"


def behind(report: Report) -> str:
    """State inputs and alternatives of the effects, the number of undecided candidates, and the orientation error, if
    any."""
    inputs = list(inputs_in_words(report))
    followed = f"The found effects depend on {wording.listed(inputs)}." if report.kind == "discover" and inputs else ""
    return " ".join(filter(None, (followed, *_undecided(report), _rejected(report), *_orientation(report))))


def _orientation(report: Report) -> Iterator[str]:
    """State the orientation error of the two models that the verdict compares, if orientation was measured."""
    names = dict.fromkeys((report.before_and_after()[0], report.shipped))
    steps = [step for name in names if (step := report.step(name)) is not None]
    turns = [turn for step in steps if (turn := report.turn_mrad(step)) is not None]
    if turns:
        sizes = " → ".join(wording.significant(value, 3) for value in turns)
        there = wording.turned(turns[-1], farthest_tool_point(report))
        yield f"Orientation: {report.title(steps[0])} {sizes} mrad RMS on {_where(report)}{there}."


def farthest_tool_point(report: Report) -> float:
    """Return the distance of the farthest tool point from the flange, m; 0 if no tool point is known."""
    squares: dict[str, float] = defaultdict(float)
    for one in report.placement:
        if one.name.startswith("tool") and one.name[-2:] in (" x", " y", " z") and one.unit == "m":
            squares[one.name[:-1]] += (one.value or 0.0) ** 2
    return math.sqrt(max(squares.values(), default=0.0))


def _rejected(report: Report) -> str:
    count = len(report.rejected)
    left = "candidate needs" if count == 1 else "candidates need"
    return f"{_count(count)} rejected {left} further poses for a decision.".capitalize() if count else ""


def _undecided(report: Report) -> Iterator[str]:
    """Name each found effect that the measured poses do not distinguish from another cause."""
    for effect in report.effects:
        others = effect.others
        if likely := effect.most_probable_cause:
            yield (
                f"The fitted {effect.name} ({wording.percent(effect.probability)}) is a less probable cause than "
                f"{likely.names[0]} ({wording.percent(likely.probability)})."
            )
        elif others and effect.probability is not None and effect.probability < SURE:
            count = len(others) - 1
            more = f" and {count if count > 1 else 'one'} more cause{'s' * (count > 1)}" if count else ""
            yield f"These poses do not separate {effect.name} from {others[0].names[0]}{more}."


def inputs_in_words(report: Report) -> Iterator[str]:
    """Yield the inputs of effects in words; loads of one kind are named once with all joints."""
    joints, sliding = report.mechanism.joints, report.mechanism.sliding
    inputs = list(dict.fromkeys(x for e in report.effects for x in e.inputs))
    if loads := [x for x in inputs if _LOAD.match(x)]:
        yield f"the gravity loads of {spans(_places(loads, joints), ('base', *joints))}"
    angles = [x for x in inputs if x in joints]
    for what, own in (("angle", set(angles) - set(sliding)), ("travel", set(angles) & set(sliding))):
        if own:
            yield f"the {what}{'s' * (len(own) > 1 and what == 'angle')} of {spans(tuple(own), joints)}"
    others = list(dict.fromkeys(s for x in inputs if x not in (*loads, *angles) for s in read_by(x) or (x,)))
    yield from (f"the motion of {x}" if x in joints else x.replace("_", " ") for x in others[:LISTED])
    if len(others) > LISTED:
        yield f"{len(others) - LISTED} more inputs"


def spans(names: Sequence[str], order: Sequence[str]) -> str:
    """Write names of joints in the given order, three or more neighbours as a range: `J1-J3, J5`."""
    at = sorted(order.index(n) for n in set(names) if n in order)
    runs = np.split(np.array(at, dtype=int), np.flatnonzero(np.diff(at) != 1) + 1) if at else []
    said = []
    for run in runs:
        row = [order[k] for k in run]
        said += ["the base"] if row[0] == "base" else []
        row = row[row[0] == "base" :]
        said += [f"{row[0]}-{row[-1]}"] if len(row) > 2 else row
    return wording.listed(said)


def _places(loads: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the base or joint at which each load (force or torque) acts."""
    found = [match["at"].partition("_of_")[0] for load in loads if (match := _LOAD.match(load))]
    by_length = sorted(("base", *joints), key=len, reverse=True)
    return [next((p for p in by_length if at == p or at.startswith(f"{p}_")), "") for at in found]


def _count(number: int) -> str:
    return COUNTS[number] if number < len(COUNTS) else str(number)


def _where(report: Report) -> str:
    return "held-out poses" if report.held else "training poses"


def _left_out(report: Report) -> str:
    rows = report.data.outliers
    return f" {wording.left_out(rows, report.data.poses)}." if rows else ""


def _remarks(report: Report) -> str:
    """State the outliers by row, and a held-out error far above the training error; empty without either."""
    said, last = _left_out(report), report.ladder[-1]
    held, train = last.heldout.rms_mm if last.heldout else None, last.train.rms_mm
    if held and train and held > FAR_ABOVE * train:
        said += (
            f" The held-out error is {held / train:.1f} times the training error: groups or regions of the poses "
            "differ, or the poses are few for the unknowns."
        )
    return said


def _beside_noise(report: Report, rms: float | None) -> str:
    """Compare an error, mm, with the noise floor; empty if the floor is unknown.
    An RMS error over n poses counts as equal to the floor within two standard errors, 1 / √(2 n) each."""
    floor = report.noise_floor_mm
    if floor is None or not rms:
        return ""
    if floor > STATED_TOO_LARGE * rms:
        return (
            f", {floor / rms:.0f} times less than the stated noise of {wording.length(floor)}: the stated "
            "noise is too large"
        )
    count = (report.data.heldout if report.held else report.data.train) or 1
    if rms <= floor * (1 + 2 / np.sqrt(2 * count)):
        return ", at the noise floor"
    return f", noise floor {wording.length(floor)}"


def of_calibration(report: Report) -> str:
    """State the calibrated model, and the error before and after calibration."""
    last = report.ladder[-1]
    what = wording.listed(["the standard model", *(e.name for e in report.effects)][: 1 + MOST_SIZED])
    if len(report.effects) > MOST_SIZED:
        what = f"the standard model and {_count(len(report.effects))} effects"
    beside = f" and {last.step}" if last.step == PRIOR else ""
    where = f"{_where(report)}{_beside_noise(report, last.errors.rms_mm)}"
    known = f" {report.unseen[0][0].upper()}{report.unseen[0][1:]}." if report.unseen else ""
    return f"Calibrated with {what}{beside}: {_change(report)} on {where}.{_remarks(report)}{known}"


def of_evolution(report: Report) -> str:
    """State the inputs that evolved programs contain significantly, and the share that the best one explains."""
    histogram = report.histograms[0]
    real = [run for run in report.runs if not run.shuffled]
    best = max((run.gain for run in real if run.gain is not None), default=None)
    stated, found = words.significant_inputs(histogram), "No input is significant"
    if histogram.significant:
        found = f"The residual depends on {stated}"
    elif stated == words.TOO_FEW:
        found = "The runs are too few to tell whether an input matters"
    if report.effects:
        found = f"Given {wording.listed([e.name for e in report.effects])}: {found[0].lower()}{found[1:]}"
    said = f"{found}; the best of {len(real)} programs removes {wording.percent(best)} of the scored residual."
    return said + _left_out(report)
