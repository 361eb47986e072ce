"""Build the Report of a search (`discover`) or of an evolution (`evolve`)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.application.further import heldout_fits, saved_step
from gpmodel.application.model_file import SavedModel
from gpmodel.calibration.unobservable import unobservable_families
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.state import Discovery, Round
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.description_length import fit_nats
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.problems import COORDINATES, CartesianProblem, Problem
from gpmodel.evolution.runs import Run
from gpmodel.families.candidate import FORMULAS, Candidate
from gpmodel.formula.expression import parse
from gpmodel.formula.program import length
from gpmodel.model.sites import names_of, translate
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build, orientation_record, reading_records
from gpmodel.report.effects import effect_records, named_effects, shape_record
from gpmodel.report.origin import Origin
from gpmodel.report.schema import REGISTRATION, STANDARD, Report
from gpmodel.report.schema_search import (
    CandidateRecord,
    CauseRecord,
    CompensationRecord,
    EffectRecord,
    FormulaRecord,
    RivalRecord,
    RoundRecord,
    ShapeRecord,
    TestRecord,
)
from gpmodel.table.blocks import FOLD_SEED


def in_the_table(counted: Histogram, names: Mapping[str, str]) -> Histogram:
    """Return the histogram of inputs with the input names of the table."""
    return replace(counted, inputs=tuple(names.get(x, x) for x in counted.inputs))


def from_evolution(
    start: Ladder, runs: Sequence[Run], counted: Histogram, origin: Origin, best: CompensationRecord
) -> Report:
    """Build the report of an evolution: fitted models, the best program of every run, and the referenced inputs.
    start: models fitted to the training poses; programs explain the residual of the last of them."""
    names = names_of(start.poses.dataset)
    report = replace(
        build("evolve", start, origin),
        effects=tuple(named_effects(start)),
        histograms=(in_the_table(counted, names),),
        runs=tuple(replace(run, site=translate(run.site, names)) for run in runs),
        compensation=replace(best, inputs=tuple(names.get(x, x) for x in best.inputs)),
    )
    return replace(report, verdict=verdict.of_evolution(report))


def compensation(runs: Sequence[Run], problem: Problem) -> CompensationRecord:
    """Return the outputs of the best evolved program at the training poses, with its inputs.
    A compensator puts out shifts of the point, mm; outputs at a frame (slot) are basis functions without factor."""
    best = max((run for run in runs if not run.shuffled), key=lambda run: run.gain)
    program, columns = parse(best.program), problem.inputs.mapping()
    values = np.asarray(program.evaluate(columns), dtype=float).reshape(len(program.outputs), -1)
    outputs = tuple(str(program.select([k])) for k in range(len(program.outputs)))
    if isinstance(problem, CartesianProblem):
        values, outputs = values - problem.inputs.select(COORDINATES).values, tuple(f"Δ{c}, mm" for c in COORDINATES)
    read = tuple(name for name in problem.inputs.names if name in program.inputs)
    columns_read = tuple(fitted.finite(columns[name]) for name in read)
    values_read = tuple(fitted.finite(row) for row in values)
    return CompensationRecord(f"{best.representation} {best.number + 1}", read, columns_read, outputs, values_read)


def fronts(discovery: Discovery) -> list[tuple[FormulaRecord, ...]]:
    """Return for each finding the Pareto front of formulas at its site, shortest first; empty without a formula. The
    gain in log likelihood, nats, is ν/2 · -ln(1 - g) for a formula that removes the share g of the residual sum of
    squares of ν degrees of freedom, given all other effects of the model fitted to all poses."""
    found = discovery.fitted.candidates
    able = [one.found_by in FORMULAS and len(one.effects) == 1 for one in found]
    if not any(able):
        return [()] * len(found)
    residual = residual_of(discovery.found, discovery.poses, Criteria(), FOLD_SEED)
    return [_front(discovery, one, residual) if can else () for one, can in zip(found, able, strict=True)]


def _front(discovery: Discovery, found: Candidate, residual: Residual) -> tuple[FormulaRecord, ...]:
    rest = [c for r in discovery.rounds for c in r.formulas if _replaces(c, found)]
    names, pool = names_of(discovery.poses.dataset), [found, *rest]
    records = [
        FormulaRecord(
            translate(str(c.bases[0]), names),
            length(parse(str(c.bases[0]))),
            float(fit_nats(score.gain, residual.freedom)),
            c is found,
        )
        for c, score in zip(pool, scores(residual.without(found.effects), pool), strict=True)
    ]
    most, kept = 0.0, []
    for record in sorted(records, key=lambda one: (one.nodes, -one.nats)):
        if record.taken or record.nats > most:
            kept.append(record)
            most = max(most, record.nats)
    return tuple(kept)


def _replaces(candidate: Candidate, found: Candidate) -> bool:
    """Return whether a formula acts at the site of a finding and depends on an input of the finding."""
    (term,), own = found.effects[0].terms[:1], candidate.effects
    there = len(own) == 1 and (own[0].terms[0].slot, own[0].terms[0].axis) == (term.slot, term.axis)
    return there and set(candidate.inputs) <= set(found.inputs) and candidate.bases != found.bases


def from_discovery(discovery: Discovery, origin: Origin, saved: SavedModel | None = None) -> Report:
    """Build the report of a discovery with the names of the table. saved: content of model.json."""
    poses, final = discovery.poses, discovery.final
    names = names_of(poses.dataset)
    unobservable = tuple(translate(name, names) for name in unobservable_families(final, poses))
    parts = heldout_fits(discovery)
    ladder = Ladder(poses, discovery.train, discovery.steps, final, (), None, saved, saved_step(discovery), parts)
    common = build("discover", ladder, origin)
    if discovery.folds:
        common = _by_folds(common, discovery)
    report = replace(
        common,
        effects=tuple(_effects(discovery, names)),
        histograms=_histograms(discovery, names),
        rounds=tuple(_round(r, _as_fitted(discovery), names) for r in discovery.rounds),
        rank_curve=common.rank_curve or discovery.steps[1].calibration.rank_curve,
        stopped=discovery.stopped,
        confirmation=discovery.confirmation,
        unobservable=unobservable,
        plots=replace(common.plots, shapes=_shapes(discovery, names)),
    )
    return replace(report, verdict=verdict.of_discovery(report))


def _by_folds(report: Report, discovery: Discovery) -> Report:
    """Return the report of a search on all poses, with the error of each pose from the fold without the pose."""
    count, plots = len(discovery.poses), report.plots
    errors = {name: replace(sides, train=()) for name, sides in plots.error_mm.items()}
    held = [(part, part.poses.subset(part.heldout)) for part in discovery.parts]
    last = len(discovery.steps) - 1
    steps = [[(part.step(k).calibration, poses) for part, poses in held] for k in (0, 1, last)]
    if plots.turn_mrad:
        angles = (fitted.finite(1e3 * fitted.turns(fits, discovery.poses)) for fits in steps)
        plots = replace(plots, turn_mrad=dict(zip((REGISTRATION, STANDARD, "final"), angles, strict=True)))
    plots = replace(plots, heldout_mask=(True,) * count, error_mm=errors)
    return replace(
        report,
        readings=(
            *reading_records(discovery.poses, discovery.final, steps[::2]),
            *orientation_record(plots, discovery.final, report.data.outliers),
        ),
        data=replace(report.data, heldout=count, folds=discovery.folds),
        plots=plots,
    )


def _histograms(discovery: Discovery, names: Mapping[str, str]) -> tuple[Histogram, ...]:
    """Return one histogram of inputs per round of the search; empty without evolved programs."""
    counted = [r.exploration.histogram for r in discovery.rounds]
    return tuple(in_the_table(h, names) for h in counted) if any(sum(h.runs.values()) for h in counted) else ()


def _effects(discovery: Discovery, names: Mapping[str, str]) -> Iterator[EffectRecord]:
    """Yield the records of all findings, with test results and alternatives."""
    poses, steps = discovery.poses, {step.finding: step for step in discovery.steps}
    records = effect_records(discovery.found, poses, discovery.fitted.candidates, names, poses.states)
    formulas = fronts(discovery)
    for i, record in enumerate(records):
        finding, hypothesis, step = discovery.findings[i], discovery.findings[i].hypothesis, steps.get(i)
        unnamed = "" if record.catalogue else "matches no named effect"
        yield replace(
            record,
            explanation=record.explanation or unnamed,
            causes=tuple(_causes(hypothesis, record.name, names)),
            without_name=hypothesis.causes.none if hypothesis.causes else 0.0,
            rivals=tuple(RivalRecord(translate(n, names), fitted.optional(1e3 * v)) for n, v in hypothesis.rivals),
            cv_rms_mm=1e3 * hypothesis.cv_rms,
            cv_before_mm=1e3 * hypothesis.cv_before,
            p_value=hypothesis.chance.p,
            shuffles=hypothesis.chance.shuffles,
            shuffled=hypothesis.chance.noun,
            tests=_tests(hypothesis),
            gain=hypothesis.score.gain,
            sign_stable=bool(hypothesis.verdict.passed("sign")),
            round=finding.round,
            heldout_rms_mm=None if step is None else fitted.statistics_mm(step.heldout_error).rms_mm,
            constants=discovery.fitted.constants[i],
            front=formulas[i],
        )


def _causes(hypothesis: Hypothesis, name: str, names: Mapping[str, str]) -> Iterator[CauseRecord]:
    """Yield the causes in the credible set of a finding; `name` is the name of the finding in the fit to all poses."""
    for cause in hypothesis.causes.causes if hypothesis.causes else ():
        said = tuple(name if cause.own and k == 0 else translate(g.name, names) for k, g in enumerate(cause.groups))
        yield CauseRecord(said, cause.probability, cause.own, cause.amount)


def _tests(hypothesis: Hypothesis) -> tuple[TestRecord, ...]:
    return tuple(
        TestRecord(t.name, fitted.optional(t.value), fitted.optional(t.limit), bool(t.passed))
        for t in hypothesis.verdict.tests
    )


def _as_fitted(discovery: Discovery) -> dict[str, str]:
    """Map the name of each finding in the search to its name in the final fit to all poses."""
    pairs = zip(discovery.findings, discovery.fitted.candidates, strict=True)
    return {finding.candidate.name: candidate.name for finding, candidate in pairs}


def _round(entry: Round, fitted_as: Mapping[str, str], names: Mapping[str, str]) -> RoundRecord:
    tried = (_tried(h, names) for h in entry.hypotheses)
    called = {translate(old, names): translate(new, names) for old, new in fitted_as.items()}
    return RoundRecord(
        round=entry.number,
        candidates=tuple(replace(c, name=called.get(c.name, c.name)) for c in tried),
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
        cv_before_mm=fitted.optional(1e3 * hypothesis.cv_before),
        found_by=candidate.found_by,
        catalogue=candidate.family or None,
        p_value=hypothesis.chance.p,
        shuffles=hypothesis.chance.shuffles,
        tests=_tests(hypothesis),
        accepted=hypothesis.accepted,
        why=hypothesis.why,
    )


def _shapes(discovery: Discovery, names: Mapping[str, str]) -> tuple[ShapeRecord, ...]:
    poses, last = discovery.poses, discovery.steps[-1].calibration
    heldout = np.isin(np.arange(len(poses)), discovery.heldout)
    found = (shape_record(last, poses, finding.candidate, heldout, names) for finding in discovery.findings)
    return tuple(replace(shape, effect=i) for i, shape in enumerate(found) if shape)
