"""Explanation of a finding: site, size at the tool, likely cause, and measurements that would confirm the finding."""

from collections.abc import Iterator, Set
from dataclasses import dataclass

from gpmodel import wording
from gpmodel.errors import InputError
from gpmodel.families.candidate import NAMED, STANDARD_TEMPERATURE
from gpmodel.mechanism.protocol import INSTRUMENT
from gpmodel.model.memory import constant_of, read_by
from gpmodel.report import charts_errors, words
from gpmodel.report.page import render, sentence
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord
from gpmodel.report.words import beside_specification
from gpmodel.table.units import is_time, known_unit


@dataclass(frozen=True)
class Explanation:
    """Explanation of a finding (accepted effect) as sentences.

    number: number of the finding, from 1.
    chain: frames of the arm in order, with the frame of the finding in brackets.
    facts, advice, repair: sentences on the finding, on further measurements, and on repair of the machine.
    """

    number: int
    name: str
    value: str
    chain: str
    where: str
    size: str
    cause: str
    facts: tuple[str, ...]
    advice: tuple[str, ...]
    repair: tuple[str, ...] = ()


def explain(report: Report, number: int, tellable: Set[str] | None = None) -> Explanation:
    """Explain finding `number`, from 1, of a report. Raises InputError if the report has no finding `number`.
    tellable: names of causes that further poses could distinguish from the finding; None if not computed."""
    if not 1 <= number <= len(report.effects):
        have = f"1 to {len(report.effects)}" if report.effects else "a report with findings"
        raise InputError(f"finding {number}: not in the report; expected {have}")
    effect = report.effects[number - 1]
    value = wording.measured(effect.value, effect.stderr, effect.unit)
    return Explanation(
        number=number,
        name=words.title(effect),
        value=f"{value} {'; '.join(basis for basis, _ in words.written(effect))}",
        chain=_chain(report, effect),
        where=sentence("; ".join(words.places(effect))),
        size=_size(effect),
        cause=_cause(effect),
        facts=tuple(map(sentence, _facts(report, effect))),
        advice=tuple(map(sentence, advice(report, effect, tellable))),
        repair=tuple(f"{sentence(heading)[:-1]}: {said}" for heading, said in effect.repair.lines)
        if effect.repair
        else (),
    )


def text(found: Explanation) -> str:
    """Return the explanation of a finding as text of 80 columns."""
    blocks = (
        ("", (found.value,)),
        ("site", (found.chain, found.where)),
        ("size at the tool", (found.size,)),
        ("physical cause", (found.cause,)),
        ("evidence", found.facts),
        ("what to measure for confirmation", found.advice),
        ("for maintenance", found.repair),
    )
    lines = [f"{found.number}  {found.name}"]
    for heading, sentences in blocks:
        lines += [f"   {heading}"] if heading else []
        lines += [wording.wrapped(s, 5) for s in sentences if s]
    return "\n".join(lines)


def html(report: Report, number: int, tellable: Set[str] | None = None) -> str:
    """Return the explanation of a finding as an HTML page."""
    found = explain(report, number, tellable)
    picture = next((p for p in charts_errors.pictures(report) if p.name == f"moved_{number}"), None)
    return render("explain.html.j2", report=report, found=found, picture=picture)


def _chain(report: Report, effect: EffectRecord) -> str:
    """Draw the chain of joints as text, base ─ J1 ─ [J2] ─ ... ─ tool, with the sites of an effect in brackets."""
    slots = [t.slot for t in effect.terms] or effect.slot.split(",")
    places = {slot.strip().partition(".")[0] for slot in slots}
    nodes = ("base", *report.mechanism.joints, "tool", *places & {INSTRUMENT})
    return " ─ ".join(f"[{n}]" if n in places else n for n in nodes)


def _size(effect: EffectRecord) -> str:
    if effect.tool_rms_mm is None:
        return "Not known: the report was written by an earlier version of gpmodel; run the calibration again."
    measured = _moves(effect.tool_rms_mm, effect.tool_max_mm)
    if effect.tool_turn_mrad is not None:
        measured += f"; rotation of the tool {wording.significant(effect.tool_turn_mrad, 3)} mrad RMS"
    if effect.workspace_rms_mm is None:
        return f"Displacement of the measured point at the measured poses: {measured}."
    anywhere = _moves(effect.workspace_rms_mm, effect.workspace_max_mm)
    return (
        f"Displacement of the tool over the workspace, with all joints within their limits: {anywhere}. At "
        "the measured "
        f"poses: {measured}."
    )


def _moves(rms: float | None, most: float | None) -> str:
    return f"{wording.length(rms)} RMS and {wording.length(most)} at most"


def _facts(report: Report, effect: EffectRecord) -> Iterator[str]:
    if effect.cv_rms_mm is not None and effect.cv_before_mm is not None:
        yield (
            f"the cross-validated error falls from {wording.length(effect.cv_before_mm)} to "
            f"{wording.length(effect.cv_rms_mm)} RMS if the effect is added"
        )
    if effect.p_value is not None:
        yield f"probability of this gain by chance: {wording.chance(effect.p_value, effect.shuffles, effect.shuffled)}"
    if pointed := words.beforehand(report, effect):
        yield f"the histogram of referenced inputs {pointed}"
    yield from words.constants(effect)
    for r in effect.ranges:
        unit = f" {wording.pretty_unit(r.unit)}".rstrip()
        yield wording.minus(
            f"the effect is valid only for {r.input} from {r.low:.4g} to {r.high:.4g}{unit}, the range in training"
        )
    if effect.unique_share is not None:
        yield (
            f"{wording.percent(effect.unique_share)} of the displacement is explained by nothing else in the "
            "model (unique share)"
        )
    for said in filter(None, (beside_specification(effect), words.causes(effect))):
        yield said
    if len(effect.front) > 1:
        taken = next(k for k, formula in enumerate(effect.front, 1) if formula.taken)
        yield (
            f"the formula is number {taken} of {len(effect.front)} in the report; to use another formula, run gpmodel "
            "calibrate with --findings and --formula"
        )
    if said := words.confirmed(report):
        yield f"the findings are jointly {said}"


def _cause(effect: EffectRecord) -> str:
    """State the physical cause of an effect from its family, or else how the effect entered the model."""
    if effect.explanation:
        return " ".join(filter(None, (sentence(effect.explanation), effect.against)))
    if effect.found_by == NAMED:
        return "Unknown: the user named this effect, and no family of the catalogue describes the effect."
    return "Unknown: no family of the catalogue describes this effect, whose formula was fitted to the residual."


LOW_SHARE = 0.3
"""Unique share of an effect below which its standard error is more than three times as large as if the other unknowns
were known (1 / share)."""
WELL_KNOWN = 10.0
"""Ratio of an effect's value to its standard error above which the value is known within a tenth."""

MEASURES = {
    "clock": "measure the first poses again at the end of the session and on the next day: an effect of the session "
    "does not recur",
    "temperature": "measure twelve poses with a cold and with a warm machine, and add a column with the temperature",
    "payload": "measure twelve poses with two or more payloads",
    "load": "measure twelve poses with and without payload: an effect of a load changes with the "
    "payload, an effect of an "
    "angle does not",
    "approach": "approach twelve poses from both directions of the joint, and add the direction as a column approach_J",
    "delay": "change the input in one step, then repeat the same poses until the positions are constant",
    "speed": "approach the same poses slowly and fast",
}
"""Measurements that distinguish an effect of each kind of column from all other effects."""


def kinds_of(name: str, unit: str, joints: Set[str]) -> tuple[str, ...]:
    """Return the roles of an input column, of clock, temperature, payload, load, approach, delay and speed."""
    derived = constant_of(name)
    if derived is not None:
        what, source, _ = derived
        return ("delay" if what == "lag" else "approach", *kinds_of(source, unit, joints))
    if read_by(name) or name in {f"approach_{j}" for j in joints} or name.startswith("approach_"):
        return ("approach",)
    if name == "row" or is_time(unit):
        return ("clock",)
    if name in joints:
        return ()
    if name.startswith(("torque_", "moment_", "force_", "payload_torque_")):
        return ("load",)
    if name == "payload":
        return ("payload",)
    if unit in STANDARD_TEMPERATURE:
        return ("temperature",)
    return ("speed",) if _is_speed(unit) else ()


def _is_speed(unit: str) -> bool:
    amount, stroke, per = unit.partition("/")
    return bool(stroke) and known_unit(amount) and is_time(per)


def advice(report: Report, effect: EffectRecord, tellable: Set[str] | None) -> Iterator[str]:
    """Yield sentences that advise on further measurements for an effect.
    tellable: names of causes that other poses could distinguish from the effect; None if not computed."""
    close = [cause.names[0] for cause in effect.others]
    told = [name for name in close if tellable is None or name in tellable]
    if told:
        yield (
            f"measure poses that separate this effect from {told[0]}: `gpmodel poses --after RESULT` selects the poses"
        )
    elif close:
        yield (
            f"no poses of this mechanism separate this effect from {close[0]}: measure another quantity, for "
            "example with "
            "a changed payload, a second tool point or the orientation"
        )
    elif effect.value and effect.stderr is not None and abs(effect.value) < WELL_KNOWN * effect.stderr:
        yield (
            "measure the poses that reduce the ± of this effect most: `gpmodel poses --after RESULT --criterion effect`"
        )
    units, joints = {r.input: r.unit for r in effect.ranges}, frozenset(report.mechanism.joints)
    found = {kind for name in effect.inputs for kind in kinds_of(name, units.get(name, "1"), joints)}
    yield from (said for kind, said in MEASURES.items() if kind in found)
    angles = [name for name in effect.inputs if name in joints]
    if angles:
        yield (
            f"move {' and '.join(angles)} alone through the whole range in both directions, with all other joints still"
        )
    if effect.unique_share is not None and effect.unique_share < LOW_SHARE:
        near = ", ".join(c.name for c in effect.correlated_with[:3]) or "the standard model"
        yield f"extend the ranges of the joints: at these poses the effect is nearly equivalent to {near}"
    if report.noise_floor_mm is None:
        yield "repeat some poses: the repeats give the noise floor, the smallest error that a model can reach"
