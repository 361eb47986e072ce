"""One finding in words: where it sits, how large it is at the tool, what would cause it, what to measure to be sure."""

from collections.abc import Iterator, Set
from dataclasses import dataclass

from gpmodel import wording
from gpmodel.errors import InputError
from gpmodel.families.candidate import NAMED
from gpmodel.mechanism.protocol import INSTRUMENT
from gpmodel.model.memory import constant_of, read_by
from gpmodel.report import charts_space, words
from gpmodel.report.page import render, sentence
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord
from gpmodel.report.words import beside_specification
from gpmodel.table.units import is_time, known_unit


@dataclass(frozen=True)
class Explanation:
    """number: of the finding, from 1. chain: the slots with the place marked. facts, advice, repair: sentences, the
    last for the one who repairs."""

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
    """Finding `number`, from 1, of a report. Raises InputError where it has none of that number.

    tellable: names of the causes that further poses could distinguish from the findings, if requested.
    """
    if not 1 <= number <= len(report.effects):
        have = f"it has {len(report.effects)}" if report.effects else "it has none"
        raise InputError(f"finding {number}: no such finding in the report; {have}")
    effect = report.effects[number - 1]
    value = wording.measured(effect.value, effect.stderr, effect.unit)
    return Explanation(
        number=number,
        name=effect.name,
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
    """The explanation in 80 columns."""
    blocks = (
        ("", (found.value,)),
        ("where", (found.chain, found.where)),
        ("size at the tool", (found.size,)),
        ("what would cause it", (found.cause,)),
        ("what speaks for it", found.facts),
        ("what to measure to be sure", found.advice),
        ("for the one who repairs", found.repair),
    )
    lines = [f"{found.number}  {found.name}"]
    for heading, sentences in blocks:
        lines += [f"   {heading}"] if heading else []
        lines += [wording.wrapped(s, 5) for s in sentences if s]
    return "\n".join(lines)


def html(report: Report, number: int, tellable: Set[str] | None = None) -> str:
    """The explanation as a page."""
    from gpmodel.report.figures import drawn

    found = explain(report, number, tellable)
    picture = next((p for p in charts_space.pictures(report) if p.name == f"moved_{number}"), None)
    drawing = drawn([picture])[picture.name] if picture else ""
    return render("explain.html.j2", report=report, found=found, picture=picture, drawing=drawing)


def _chain(report: Report, effect: EffectRecord) -> str:
    """base ─ J1 ─ [J2] ─ ... ─ tool, with every place of the effect in brackets."""
    slots = [t.slot for t in effect.terms] or effect.slot.split(",")
    places = {slot.strip().partition(".")[0] for slot in slots}
    nodes = ("base", *report.mechanism.joints, "tool", *places & {INSTRUMENT})
    return " ─ ".join(f"[{n}]" if n in places else n for n in nodes)


def _size(effect: EffectRecord) -> str:
    if effect.tool_rms_mm is None:
        return "Not known: the report is of an earlier version; make it again."
    measured = _moves(effect.tool_rms_mm, effect.tool_max_mm)
    if effect.tool_turn_mrad is not None:
        measured += f", and turns it by {wording.significant(effect.tool_turn_mrad, 3)} mrad RMS"
    if effect.workspace_rms_mm is None:
        return f"Moves the measured point by {measured} over the measured poses."
    anywhere = _moves(effect.workspace_rms_mm, effect.workspace_max_mm)
    return (
        f"Moves the tool by {anywhere} over the workspace, all joints anywhere within their limits; over the measured "
        f"poses by {measured}."
    )


def _moves(rms: float | None, most: float | None) -> str:
    return f"{wording.length(rms)} RMS and {wording.length(most)} at most"


def _facts(report: Report, effect: EffectRecord) -> Iterator[str]:
    if effect.cv_rms_mm is not None and effect.cv_before_mm is not None:
        yield (
            f"the cross-validated error falls from {wording.length(effect.cv_before_mm)} to "
            f"{wording.length(effect.cv_rms_mm)} RMS with it"
        )
    if effect.p_value is not None:
        yield f"chance of its score: {wording.chance(effect.p_value, effect.shuffles, effect.shuffled)}"
    if pointed := words.beforehand(report, effect):
        yield f"the histogram of referenced inputs {pointed}"
    yield from words.constants(effect)
    for r in effect.ranges:
        unit = f" {wording.pretty_unit(r.unit)}".rstrip()
        yield wording.minus(f"it was trained on {r.input} from {r.low:.4g} to {r.high:.4g}{unit} and holds there only")
    if effect.unique_share is not None:
        yield f"{wording.percent(effect.unique_share)} of its signature is explained by nothing else in the model"
    for said in filter(None, (beside_specification(effect), words.causes(effect))):
        yield said
    if len(effect.front) > 1:
        taken = next(k for k, formula in enumerate(effect.front, 1) if formula.taken)
        yield (
            f"its formula is number {taken} of {len(effect.front)} on the page, none of which a shorter one equals in "
            "gain; calibrate takes another by --findings and --formula"
        )
    if said := words.confirmed(report):
        yield f"all findings together are {said}"


def _cause(effect: EffectRecord) -> str:
    """State the physical cause from the effect's family, else how the effect entered the model."""
    if effect.explanation:
        return sentence(effect.explanation)
    if effect.found_by == NAMED:
        return "No family of the catalogue describes it: it was named by the user, not found."
    return "No mechanism is known for it: it follows the error, and no family of the catalogue describes it."


LOW_SHARE = 0.3
"""Unique share below which the standard error is more than three times what it would be with the other unknowns known
(1 / share)."""
WELL_KNOWN = 10.0
"""Standard errors from zero of a value that is known to a tenth."""

MEASURES = {
    "clock": "measure the first poses once more at the end, and once after a night: an event of the session does not "
    "come back",
    "temperature": "measure the same dozen poses cold and warm, the temperature in its own column",
    "payload": "measure the same dozen poses with two payloads at least",
    "load": "measure the same dozen poses with and without payload: a load's part grows with it, an angle's does not",
    "approach": "approach the same dozen poses from either side of the joint, the direction in a column approach_J",
    "delay": "change it in one step, then measure the same poses again and again until they are still",
    "speed": "approach the same poses slowly and fast",
}
"""By the kind of a column: what would tell its effect from everything else."""


def kinds_of(name: str, unit: str, joints: Set[str]) -> tuple[str, ...]:
    """Return the kinds of a column: clock, temperature, payload, load, approach, delay, speed; none for an angle or
    an unknown.
    """
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
    if unit in ("degC", "degF", "K"):
        return ("temperature",)
    return ("speed",) if _is_speed(unit) else ()


def _is_speed(unit: str) -> bool:
    amount, stroke, per = unit.partition("/")
    return bool(stroke) and known_unit(amount) and is_time(per)


def advice(report: Report, effect: EffectRecord, tellable: Set[str] | None) -> Iterator[str]:
    """Sentences; tellable: the causes that further poses could tell from it, by name; None if not requested."""
    close = [cause.names[0] for cause in effect.others]
    told = [name for name in close if tellable is None or name in tellable]
    if told:
        yield f"take poses at which it and {told[0]} differ: `gpmodel poses --after` this result chooses them"
    elif close:
        yield (
            f"no poses of this mechanism tell it from {close[0]}: only another quantity does, such as a changed "
            "payload, a second point of the tool or the orientation"
        )
    elif effect.value and effect.stderr is not None and abs(effect.value) < WELL_KNOWN * effect.stderr:
        yield "take the poses that tell most of it: `gpmodel poses --after` this result with `--criterion effect`"
    units, joints = {r.input: r.unit for r in effect.ranges}, frozenset(report.mechanism.joints)
    found = {kind for name in effect.inputs for kind in kinds_of(name, units.get(name, "1"), joints)}
    yield from (said for kind, said in MEASURES.items() if kind in found)
    angles = [name for name in effect.inputs if name in joints]
    if angles:
        yield f"sweep {' and '.join(angles)} alone through the whole range, all other joints still, in both directions"
    if effect.unique_share is not None and effect.unique_share < LOW_SHARE:
        near = ", ".join(c.name for c in effect.correlated_with[:3]) or "the standard model"
        yield f"widen the range of the joints: on these poses it is hard to tell from {near}"
    if report.noise_floor_mm is None:
        yield "repeat some poses: without a noise floor nobody knows how much is left to find"
