"""One finding in words: where it sits, how large it is at the tool, what would cause it, what to measure to be sure."""

from collections.abc import Iterator, Set
from dataclasses import dataclass
from textwrap import fill

from gpmodel import wording
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import INSTRUMENT
from gpmodel.report import words
from gpmodel.report.advice import advice
from gpmodel.report.instrument_words import beside_specification
from gpmodel.report.page import render, sentence
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord


@dataclass(frozen=True)
class Explanation:
    """number: of the finding, from 1. chain: the slots with the place marked. facts, advice: sentences."""

    number: int
    name: str
    value: str
    chain: str
    where: str
    size: str
    cause: str
    facts: tuple[str, ...]
    advice: tuple[str, ...]


def explain(report: Report, number: int, tellable: Set[str] | None = None) -> Explanation:
    """Finding `number`, from 1, of a report. Raises InputError where it has none of that number.

    tellable: the rivals that further poses could tell from their findings, by name, where somebody asked.
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
    )
    lines = [f"{found.number}  {found.name}"]
    for heading, sentences in blocks:
        lines += [f"   {heading}"] if heading else []
        lines += [fill(s, wording.WIDTH, initial_indent=" " * 5, subsequent_indent=" " * 5) for s in sentences if s]
    return "\n".join(lines)


def html(report: Report, number: int, tellable: Set[str] | None = None) -> str:
    """The explanation as a page."""
    return render("explain.html.j2", report=report, found=explain(report, number, tellable))


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
    for said in filter(None, (beside_specification(effect), words.rivals(effect))):
        yield said
    if said := words.confirmed(report):
        yield f"all findings together are {said}"


def _cause(effect: EffectRecord) -> str:
    """What would cause it, as its family says; else how it came into the model."""
    if effect.explanation:
        return sentence(effect.explanation)
    if effect.found_by == "named":
        return "No family of the catalogue describes it: it was named by the user, not found."
    return "No mechanism is known for it: it follows the error, and no family of the catalogue describes it."
