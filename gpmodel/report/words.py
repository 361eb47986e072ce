"""Write sentences for reports: on noise floor, confirmation, causes, tests of inputs, sites."""

import math
import re
from collections.abc import Iterator

import numpy as np

from gpmodel import wording
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.families.candidate import (
    BRED,
    CATALOGUE,
    FORMULA,
    FORMULA_OF_PROGRAM,
    NAMED,
    SEQUENCE,
    SMOOTH_TERM,
    STANDARD_TEMPERATURE,
    TREE,
)
from gpmodel.mechanism.protocol import INSTRUMENT
from gpmodel.numerics.interval import COVERAGE, coverage_factor
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CandidateRecord, EffectRecord

BEYOND = 2.0
"""Ratio of an instrument's error to its specification above which the instrument is out of specification. The
specification is two standard deviations, and four standard deviations do not occur by chance."""
_CAUSES = {
    "m": "check the reflector constant", "1": "check air temperature, air pressure and the unit of length",
    "rad": "the instrument needs compensation, or the mechanism causes the error",
}  # fmt: skip


def instrument(report: Report) -> str:
    """State the noise expected from the instrument's specification and the noise of the measurements; empty without a
    specification."""
    stated = report.instrument
    if stated is None:
        return ""
    found = "" if report.sigma_mm is None else f", {wording.length(report.sigma_mm)} estimated from the residual"
    return (
        f"specification {stated.specification}, {wording.length(stated.limit_mm)} at the distance of these "
        "poses; noise "
        f"of one coordinate: {wording.length(stated.noise_mm)} expected{found}"
    )


def beside_specification(effect: EffectRecord) -> str:
    """Compare a fitted error of the instrument with its specification; empty for an effect without a specification."""
    times = effect.of_specification
    if times is None:
        return ""
    if times < BEYOND:
        return f"{times:.2g} times the instrument's specification, which is admissible"
    cause = _CAUSES["rad" if effect.kind != "single" else effect.unit]
    return f"{times:.0f} times the instrument's specification: {cause}"


COVERAGE_OF_CAUSES = "95 %"
NO_NAME = "none of these: an effect outside the catalogue"
MOST_EXPLAINED = 3
"""Number of inputs of evolved programs whose tests are stated in words; the report's table has all inputs."""
_FOUND_BY = {
    CATALOGUE: "the catalogue of effects", NAMED: "named beforehand",
    SMOOTH_TERM: "a smooth term; no formula predicts as well",
    FORMULA: "enumeration of short formulas for a smooth term or an effect, without evolution",
    FORMULA_OF_PROGRAM: "enumeration of short formulas for an evolved program",
    SEQUENCE: "genetic programming (sequence of instructions)", TREE: "genetic programming (tree)",
    **{maker: f"genetic programming, generation {g} bred from short formulas" for g, maker in enumerate(BRED, 1)},
}  # fmt: skip
_SOURCES = {
    "repeats": "from the repeats in the table", "instrument": "from the stated noise of the instrument",
    "specification": "expected from the instrument's specification",
}  # fmt: skip


def noise_floor(report: Report) -> str:
    """State the noise floor and its source, or how to determine the noise floor."""
    if report.noise_from == "drift":
        return f"unknown: {wording.DRIFTING_REPEATS}"
    if report.noise_floor_mm is None:
        return "unknown: repeat some poses (a column 'repeat'), or give the noise of the instrument"
    return f"{wording.length(report.noise_floor_mm)} RMS {_SOURCES.get(report.noise_from or '', '')}".rstrip()


def predicted(report: Report) -> str:
    """State the errors of `gpmodel predict` without an option and of the last model; empty if they are equal."""
    found = report.predicted
    if found is None or not found.differs:
        return ""
    plain, measured = (
        (found.heldout, found.heldout_as_measured) if report.held else (found.model, found.model_as_measured)
    )
    where = "held-out poses" if report.held else "training poses"
    return (
        f"predict without an option: {wording.length(plain.rms_mm)} RMS on {where}, for the robot at the end of the "
        f"session and without errors of the instrument. predict --session, with both: "
        f"{wording.length(measured.rms_mm)} RMS, the last step above"
    )


def interval(report: Report) -> str:
    """State the meaning of ± σ, the coverage factor of the 95 % interval, and the temperature of the constants."""
    factor = coverage_factor(np.inf if report.freedom is None else report.freedom)
    of = "" if report.freedom is None else f", Student's t of {report.freedom:.0f} degrees of freedom"
    sure = wording.percent(COVERAGE)
    said = f"σ: standard uncertainty (k = 1); ± {factor:.2f} σ is the {sure} interval (k = {factor:.2f}{of})"
    return said + _reference(report)


def _reference(report: Report) -> str:
    """State the reference temperature of the constants, if an effect depends on a temperature."""
    warm = [(e, STANDARD_TEMPERATURE.get(r.unit)) for e in report.effects for r in e.ranges]
    counted = any(at is not None and f" - {at:g}" in t.basis for e, at in warm for t in e.terms)
    return "; tool, registration and parameters hold at 20 °C (ISO 1)" if counted else ""


def confirmed(report: Report) -> str:
    """State whether held-out poses confirm the effects that a search added; empty without added effects."""
    found = report.confirmation
    if found is None:
        return ""
    said = "confirmed on the held-out poses" if found.passed else "NOT CONFIRMED on the held-out poses"
    return (
        f"{said}: gain of {found.t:.1f} standard errors over {found.units} independent poses, "
        f"p {wording.chance(found.p_value)}, limit {found.limit:g}"
    )


def fitted_loads(said: str) -> str:
    """State which loads were fitted in place of the declared loads; empty if none were. said: the fitted loads."""
    if not said:
        return ""
    return f"The declared loads do not explain the residual; the findings hold for {said}. Check it and declare it."


def causes(effect: EffectRecord) -> str:
    """State the credible set of causes of a finding, with probabilities; empty if the set was not computed."""
    if effect.causes is None:
        return ""
    if not effect.others and not effect.alike and not effect.without_name:
        return f"no other cause is in the {COVERAGE_OF_CAUSES} credible set"
    listed = [(c.probability, " or ".join(c.names)) for c in effect.causes]
    listed += [(effect.without_name, NO_NAME)] if effect.without_name else []
    named = (f"{name} ({wording.percent(p)})" for p, name in sorted(listed, reverse=True))
    return f"possible causes ({COVERAGE_OF_CAUSES}): {'; '.join(named)}"


def title(effect: EffectRecord) -> str:
    """Return the name of a found effect, preceded by its most probable cause if the cause is another effect."""
    likely = effect.most_probable_cause
    if likely is None:
        return effect.name
    return f"{likely.names[0]} ({wording.percent(likely.probability)} likely), fitted as {effect.name}"


def moves(effect: EffectRecord) -> str:
    """State the tool's displacement by an effect, and the part that no other parameter absorbs; empty if unknown."""
    if effect.tool_rms_mm is None:
        return ""
    said = f"moves the tool by {wording.length(effect.tool_rms_mm)} RMS"
    if effect.alone_rms_mm is None:
        return said
    return f"{said}, of which no other parameter absorbs {wording.length(effect.alone_rms_mm)}"


def doubt(effect: EffectRecord) -> str:
    """State the probability of an effect and its ± over all causes; empty without alternative causes."""
    over_all = effect.stderr_over_causes
    if not effect.others or over_all is None:
        return ""
    size = wording.measured(effect.value, over_all, effect.unit)
    likely = wording.percent(effect.probability)
    return f"if this is the cause ({likely} likely; allowing for the other causes, ± {size.deviation} {size.unit})"


def beforehand(report: Report, effect: EffectRecord) -> str:
    """State whether the histogram of evolved programs indicated the inputs of a finding; empty without a histogram."""
    histogram = report.histogram_of(effect)
    if histogram is None:
        return ""
    pointed = [name for name in effect.inputs if name in histogram.significant]
    if pointed:
        return f"indicated {', '.join(pointed)} beforehand"
    return "did not indicate this effect, which was selected by its likelihood"


def story(report: Report) -> Iterator[str]:
    """Explain differences between the significant inputs of evolved programs and the inputs of the found effects."""
    read = {name for effect in report.effects for name in effect.inputs}
    for number, histogram in enumerate(report.histograms, 1):
        others = [name for name in histogram.significant if name not in read]
        chosen = [effect.name for effect in report.effects if effect.round == number]
        if not others:
            continue
        names, one = wording.listed(others), len(others) == 1
        it, stay = ("this input", "is") if one else ("these inputs", "are")
        explain = "explains" if len(chosen) == 1 else "explain"
        if not chosen:
            yield f"{names} {stay} significant, but no effect that depends on {it} passed the tests."
            continue
        later = {name for h in report.histograms[number:] for name in h.significant}
        gone = "" if later & set(others) else f"; given {wording.listed(chosen)}, no program refers to {it}"
        yield f"The programs used {names} as a proxy; {wording.listed(chosen)} {explain} the same error better{gone}."


def found(report: Report, effect: EffectRecord) -> str:
    """State how and in which round an effect was found, and the number of effects found in the same round."""
    how = _FOUND_BY.get(effect.found_by, effect.found_by)
    if effect.round is None:
        return how
    others = sum(other.round == effect.round for other in report.effects) - 1
    together = f", selected jointly with {others} other effect{'s' if others > 1 else ''}" if others else ""
    return f"{how}, in round {effect.round}{together}"


def dropped(report: Report) -> str:
    """State which constants are held at zero because they are redundant; empty without redundant constants.

    Constants on which no measurement depends are not redundant; `calibration.unobservable` lists such constants.
    """
    unseen = [p.name for p in report.parameters if not p.kept and p.stderr]
    names = [name for name in report.dropped() if name not in unseen]
    if not names:
        return ""
    if report.parameters and not report.geometry():
        return f"none of the {len(names)} geometric constants is significant: all are held at zero"
    out_of = f" of {len(report.dropped()) + len(report.geometry())}" if report.parameters else ""
    return (
        f"{len(names)}{out_of} geometric constants are redundant at these poses (every arm has redundant constants). "
        f"They are held at zero, and the other constants absorb their effects: {', '.join(names)}"
    )


def written(effect: EffectRecord) -> tuple[tuple[str, str], ...]:
    """Return the basis function of an effect and its site, one entry per site."""
    places = tuple(dict.fromkeys(f"{t.slot} {t.axis}" for t in effect.terms)) or (f"{effect.slot} {effect.axis}",)
    basis = wording.expression(effect.basis)
    if effect.kind == "curve":
        return ((f"RMS of {wording.shortened(basis, 160)}", ", ".join(places)),)
    if effect.kind != "single" or len(places) == 1:
        return ((f"× {wording.shortened(_times(1.0, basis), 160)}", ", ".join(places)),)
    return tuple((f"× {_times(t.weight, wording.expression(t.basis))}", f"{t.slot} {t.axis}") for t in effect.terms)


def constants(effect: EffectRecord) -> tuple[str, ...]:
    """Write the constants of a formula with standard errors (`lag 40.2 ± 0.9 min`), or the rows of an event."""
    out = []
    for c in effect.constants:
        if c.low is None:
            out.append(f"{c.name or 'constant in the formula'} {wording.measured(c.value, c.stderr, c.unit)}")
        else:
            sure = c.low == c.high
            out.append(f"{c.name} {c.value:.0f}" + ("" if sure else f", {c.low} to {c.high} at 95 %"))
    return tuple(out)


_INNERMOST = re.compile(r"\([^()]*\)")
"""Text in parentheses without further parentheses."""


def _times(weight: float, basis: str) -> str:
    """Write a basis function times its weight, with a sum in parentheses: `0.45·(temperature − 20)`."""
    outer = basis
    while (bare := _INNERMOST.sub("", outer)) != outer:
        outer = bare
    factors = f"({basis})" if any(sign in outer for sign in (" + ", " - ", " \N{MINUS SIGN} ")) else basis
    if weight == 1.0:
        return factors
    return ("\N{MINUS SIGN}" if weight == -1.0 else f"{wording.minus(wording.significant(weight, 3))}·") + factors


def input_tests(histogram: Histogram) -> Iterator[str]:
    """State the test results for the inputs that most evolved programs contain: count and strength."""
    runs, shuffled_runs = sum(histogram.runs.values()), sum(histogram.shuffled_runs.values())
    if not runs:
        return
    if not shuffled_runs:
        yield "no evolved program was good enough for a finding, so the comparison with permuted residuals was skipped"
        return
    limit, use, null = histogram.significance, histogram.referring, histogram.referring_by_chance
    for k in sorted(range(len(use)), key=lambda k: -use[k])[:MOST_EXPLAINED]:
        if not use[k]:
            return
        by_count, by_strength = histogram.count_p[k], histogram.strength_p[k]
        failed = [name for name, p in (("count", by_count), ("strength", by_strength)) if p >= limit]
        stands = f"is not significant (fails the test of {' and of '.join(failed)})" if failed else "is significant"
        yield (
            f"{histogram.inputs[k]} {stands}: {use[k]} of {runs} programs contain this input, "
            f"{null[k]} of {shuffled_runs} on permuted residuals "
            f"(p {wording.chance(by_count)}); probability of so good a program on permuted residuals: "
            f"p {wording.chance(by_strength, shuffled_runs)}"
        )


def rms_removed(gain: float) -> float:
    """Return the relative decrease of an RMS error if the sum of squares decreases by the share `gain`."""
    return 1.0 - math.sqrt(max(0.0, 1.0 - gain))


TOO_FEW = "too few runs to tell"


def significant_inputs(histogram: Histogram) -> str:
    """State the significant inputs of evolved programs, or whether there were enough runs for any to be significant.
    If all R runs and none of the S runs on permuted residuals reference one of I inputs, its p-value is I / C(R + S,
    R)."""
    if histogram.significant:
        return ", ".join(histogram.significant)
    runs, shuffled = sum(histogram.runs.values()), sum(histogram.shuffled_runs.values())
    least = len(histogram.inputs) / math.comb(runs + shuffled, runs)
    return TOO_FEW if runs and shuffled and least >= histogram.significance else "none"


def operators(histogram: Histogram) -> list[tuple[str, ...]]:
    """Count the best evolved programs that use each operator, by representation, the most used operator first."""
    used = {name for counts in histogram.operators.values() for name in counts}
    rows = [(name, *(str(counts.get(name, 0)) for counts in histogram.operators.values())) for name in sorted(used)]
    return [("operator", *histogram.operators), *sorted(rows, key=lambda row: -sum(map(int, row[1:])))]


def removed(report: Report) -> str:
    """State the share of the errors, and of permuted errors, that evolved programs explain; empty without runs."""
    real, null = report.removed(shuffled=False), report.removed(shuffled=True)
    if real is None or null is None:
        return ""
    alike = "" if real > null else ": no more than by chance, so that the inputs of these programs have no meaning"
    return (
        f"the best programs remove {wording.percent(real)} of the scored residual (median of the runs), and "
        f"{wording.percent(null)} of permuted residuals{alike}"
    )


def places(effect: EffectRecord) -> tuple[str, ...]:
    """Return every site of an effect in words."""
    at = dict.fromkeys((t.slot, t.axis) for t in effect.terms) or {(effect.slot, effect.axis): None}
    return tuple(place(slot, axis) or f"{slot} {axis}" for slot, axis in at)


def place(slot: str, axis: str) -> str:
    """Return a slot (frame) and an axis in words."""
    if not slot or "," in slot or "," in axis:
        return ""
    joint, _, side = slot.partition(".")
    where = {
        "base": "at the base, before the first joint",
        "tool": "at the flange, after the last joint",
        INSTRUMENT: "of the instrument, applied to its measurements before registration",
    }.get(slot, f"just {'before' if side == 'fixed' else 'after'} the motion of {joint}")
    motion = {"T": "translation along", "R": "rotation about"}.get(axis[:1], "")
    return f"{motion} {axis[1:]} of the frame {where}" if motion else where


REJECTED = (
    "These candidates are not in the model: each is significant and lowers the cross-validated error, "
    "but failed another "
    "test. Measure further poses for a decision."
)


def lowers(candidate: CandidateRecord) -> str:
    """State the cross-validated error without and with a rejected candidate, its gain and its p-value."""
    change = wording.change(candidate.cv_before_mm, candidate.cv_rms_mm)
    gain = "" if candidate.nats is None else f", gain {candidate.nats:.0f} nats"
    chance = "" if candidate.p_value is None else f", chance {wording.chance(candidate.p_value, candidate.shuffles)}"
    return f"cross-validated error {change}{gain}{chance}"


def deciding(number: int) -> str:
    """Return the command that selects poses to decide on the rejected candidate with the given number."""
    return f"gpmodel poses --after RESULT --rejected {number}"
