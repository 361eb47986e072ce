"""The Report of a discovery."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gpmodel.calibration.result import resolved
from gpmodel.calibration.unobservable import unobservable_families
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.result import Discovery, Round
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import explained
from gpmodel.model.naming import names_of, translate
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.origin import Origin, ranges
from gpmodel.report.quantity import quantity, read_columns
from gpmodel.report.referenced import histogram_record
from gpmodel.report.schema import ErrorsMm, Report
from gpmodel.report.schema_poses import ShapeRecord
from gpmodel.report.schema_search import (
    CandidateRecord,
    EffectRecord,
    HistogramRecord,
    RivalRecord,
    RoundRecord,
    TermRecord,
    TestRecord,
)
from gpmodel.report.shapes import shape_record
from gpmodel.report.workspace import over_the_workspace

MOST_TERMS = 6
"""Terms listed of one effect; a curve has dozens and its basis says so."""


def from_discovery(discovery: Discovery, origin: Origin) -> Report:
    """Everything the loop found, tried and left, under the table's own names."""
    poses, final = discovery.poses, discovery.final
    names = names_of(poses.dataset)
    unobservable = tuple(translate(name, names) for name in unobservable_families(final, poses))
    common = build("discover", Ladder(poses, discovery.train, discovery.steps, final), origin)
    if discovery.folds:
        common = _by_folds(common, discovery)
    report = replace(
        common,
        effects=_effects(discovery, names),
        histograms=_histograms(discovery, names),
        rounds=tuple(_round(r, names) for r in discovery.rounds),
        rank_curve=common.rank_curve or fitted.rank_curve(discovery.steps[1].calibration),
        stopped=discovery.stopped,
        confirmation=discovery.confirmation,
        unobservable=unobservable,
        plots=replace(common.plots, shapes=_shapes(discovery, names)),
    )
    return replace(report, verdict=verdict.of_discovery(report))


def _by_folds(report: Report, discovery: Discovery) -> Report:
    """The report of a choice on all poses, the errors of each from the choice without it."""
    count, plots = len(discovery.poses), report.plots
    errors = {name: replace(sides, train=()) for name, sides in plots.error_mm.items()}
    return replace(
        report,
        data=replace(report.data, heldout=count, folds=discovery.folds),
        plots=replace(plots, heldout_mask=(True,) * count, error_mm=errors),
    )


def _histograms(discovery: Discovery, names: Mapping[str, str]) -> tuple[HistogramRecord, ...]:
    """One a round; none where nothing was evolved in any."""
    counted = [r.exploration.histogram for r in discovery.rounds]
    return tuple(histogram_record(h, names) for h in counted) if any(sum(h.runs.values()) for h in counted) else ()


def _effects(discovery: Discovery, names: Mapping[str, str]) -> tuple[EffectRecord, ...]:
    """All findings, each with what it moves the tool by at the measured poses and anywhere."""
    final, groups = discovery.found, [c.effects for c in discovery.fitted.candidates]
    if not groups:
        return ()
    moved = fitted.tool_displacements(final, resolved(final, discovery.poses), groups)
    anywhere = over_the_workspace(final, discovery.poses, groups)
    sizes = zip(map(fitted.statistics_mm, moved), anywhere, strict=True)
    alone = fitted.moves_alone(final, discovery.poses, groups)
    return tuple(
        replace(_effect(discovery, i, names, *size), alone_rms_mm=own)
        for i, (size, own) in enumerate(zip(sizes, alone, strict=True))
    )


def _effect(
    discovery: Discovery, i: int, names: Mapping[str, str], moved: ErrorsMm, anywhere: ErrorsMm
) -> EffectRecord:
    finding, final, states = discovery.findings[i], discovery.found, discovery.poses.states
    candidate, hypothesis = discovery.fitted.candidates[i], finding.hypothesis
    number = quantity(final, candidate, states)
    first = candidate.place
    inputs = candidate.inputs
    step = next((s for s in discovery.steps if s.finding == i), None)
    return EffectRecord(
        name=translate(candidate.name, names),
        slot=translate(first.slot, names),
        axis=first.axis,
        basis=translate(number.basis, names),
        kind=candidate.kind,
        inputs=tuple(names.get(x, x) for x in read_columns(inputs)),
        value=number.value,
        stderr=fitted.optional(number.stderr),
        unit=number.unit,
        unique_share=number.unique_share,
        found_by=candidate.found_by,
        catalogue=candidate.family or None,
        explanation=_explained(candidate),
        terms=tuple(
            TermRecord(translate(t.slot, names), t.axis, translate(str(t.basis), names), t.weight)
            for e in candidate.effects[:MOST_TERMS]
            for t in e.terms
        ),
        rivals=tuple(
            RivalRecord(translate(n, names), fitted.optional(1e3 * v)) for n, v in sorted(hypothesis.rivals, key=_rms)
        ),
        correlated_with=fitted.correlations(final, candidate.effects[:2], names),
        cv_rms_mm=1e3 * hypothesis.cv_rms,
        cv_before_mm=1e3 * hypothesis.cv_before,
        p_value=hypothesis.p_value,
        shuffles=hypothesis.shuffles,
        shuffled=hypothesis.chance.of,
        tests=_tests(hypothesis),
        gain=hypothesis.score.gain,
        sign_stable=bool(hypothesis.verdict.passed("sign")),
        round=finding.round,
        heldout_rms_mm=None if step is None else fitted.statistics_mm(step.heldout_error).rms_mm,
        tool_rms_mm=moved.rms_mm,
        tool_max_mm=moved.max_mm,
        workspace_rms_mm=anywhere.rms_mm,
        workspace_max_mm=anywhere.max_mm,
        ranges=ranges(states, inputs, names),
        constants=discovery.fitted.constants[i],
    )


def _explained(candidate: Candidate) -> str:
    """What it would be physically: its own explanation, else its family's; nothing for a kind without a family."""
    unnamed = "" if candidate.family else "matches no named effect"
    return candidate.explanation or explained(candidate.family) or unnamed


def _rms(rival: tuple[str, float]) -> float:
    return rival[1]


def _tests(hypothesis: Hypothesis) -> tuple[TestRecord, ...]:
    return tuple(
        TestRecord(t.name, fitted.optional(t.value), fitted.optional(t.limit), bool(t.passed))
        for t in hypothesis.verdict.tests
    )


def _round(entry: Round, names: Mapping[str, str]) -> RoundRecord:
    return RoundRecord(
        round=entry.number,
        candidates=tuple(_tried(h, names) for h in entry.hypotheses),
        null_nats=tuple(float(v) for v in entry.exploration.null_nats if np.isfinite(v)),
        dropped=tuple(translate(n, names) for n in entry.dropped),
    )


def _tried(hypothesis: Hypothesis, names: Mapping[str, str]) -> CandidateRecord:
    candidate = hypothesis.candidate
    first = candidate.place
    return CandidateRecord(
        name=translate(candidate.name, names),
        slot=translate(first.slot, names),
        axis=first.axis,
        basis=translate(str(first.basis), names),
        inputs=tuple(names.get(x, x) for e in candidate.effects[:1] for x in e.inputs),
        gain=hypothesis.score.gain,
        nats=hypothesis.score.nats,
        cv_rms_mm=fitted.optional(1e3 * hypothesis.cv_rms),
        found_by=candidate.found_by,
        catalogue=candidate.family or None,
        p_value=hypothesis.p_value,
        shuffles=hypothesis.shuffles,
        tests=_tests(hypothesis),
        accepted=hypothesis.added,
        why=hypothesis.why,
    )


def _shapes(discovery: Discovery, names: Mapping[str, str]) -> tuple[ShapeRecord, ...]:
    poses, last = discovery.poses, discovery.steps[-1].calibration
    heldout = np.zeros(len(poses), dtype=bool)
    heldout[discovery.heldout] = True
    found = (shape_record(last, poses, finding.candidate, heldout, names) for finding in discovery.findings)
    return tuple(replace(shape, effect=i) for i, shape in enumerate(found) if shape)
