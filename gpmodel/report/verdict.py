"""The one sentence of a report."""

from collections.abc import Sequence

from gpmodel import wording
from gpmodel.report.schema import STANDARD, Report
from gpmodel.report.schema_search import EffectRecord

MOST_SIZED = 3
"""Findings whose sizes the verdict says; of more it says the names."""


def of_discovery(report: Report) -> str:
    """What the residual depends on, what was added, and what it gained on held-out poses."""
    standard, last = report.step(STANDARD), report.ladder[-1]
    before = wording.length(standard.heldout.rms_mm if standard else None)
    tail = f", noise floor {wording.length(report.noise_floor_mm)}" if report.noise_floor_mm is not None else ""
    if not report.effects:
        return f"Standard model {before} RMS on held-out poses{tail}; nothing stands out of chance: nothing was added."
    few = len(report.effects) <= MOST_SIZED
    parts = [_sized(e) for e in report.effects] if few else _by_kind(report.effects)
    inputs = list(dict.fromkeys(x for e in report.effects for x in e.inputs))
    doubted = report.confirmation is not None and not report.confirmation.passed
    doubt = "Not confirmed on held-out poses, so the standard model is kept. " if doubted else ""
    added = "would have added" if doubted else "added"
    return (
        f"{doubt}Standard model {before} RMS on held-out poses; the residual depends on {', '.join(inputs)}; "
        f"{added} {'; '.join(parts)}; {wording.length(last.heldout.rms_mm)} RMS on held-out poses{tail}; "
        f"{report.stopped}."
    )


def _by_kind(effects: Sequence[EffectRecord]) -> list[str]:
    """Names, those that differ in the joint alone said once with all their joints."""
    kinds: dict[str, list[str]] = {}
    for effect in effects:
        kind, _, joint = effect.name.rpartition(", ")
        at_joint = effect.slot.startswith(f"{joint}.")
        kinds.setdefault(kind if at_joint else effect.name, []).extend([joint] if at_joint else [])
    return [", ".join((kind, *joints)) for kind, joints in kinds.items()]


def _sized(effect: EffectRecord) -> str:
    size = wording.measured(effect.value, effect.stderr, effect.unit)
    return f"{effect.name}, {size.value} ± {size.deviation} {size.unit}"


def of_calibration(report: Report) -> str:
    """From registration to the last step."""
    first, last = report.ladder[0], report.ladder[-1]
    where = "poses held out" if first.heldout.known else "the poses fitted to"
    added = [report.title(step).removeprefix("+ ") for step in report.ladder if step.effect is not None]
    return (
        f"Error on {where}: {wording.length(first.errors.rms_mm)} RMS with registration and tool alone, "
        f"{wording.length(last.errors.rms_mm)} with {', '.join(added) or report.title(last)}."
    )


def of_evolution(report: Report) -> str:
    """Which inputs the programs refer to beyond chance, and what the best of them explains."""
    histogram = report.histograms[0]
    real = [run for run in report.runs if not run.shuffled]
    best = max((run.gain for run in real if run.gain is not None), default=None)
    inputs = ", ".join(histogram.significant)
    found = f"The residual refers to {inputs}" if inputs else "No input stands out of chance"
    return f"{found}; the best of {len(real)} programs removes {wording.percent(best)} of what they are scored by."
