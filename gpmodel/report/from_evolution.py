"""The Report of programs evolved on the residual of a fitted model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.problems import COORDINATES, CartesianProblem, Problem
from gpmodel.evolution.runs import Run
from gpmodel.formula.parse import parse
from gpmodel.model.naming import names_of, translate
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.from_calibration import named_effects
from gpmodel.report.origin import Origin
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CompensationRecord, HistogramRecord, ProgramRecord


def histogram_record(counted: Histogram, names: Mapping[str, str]) -> HistogramRecord:
    """Return the record of a histogram; `names` are the table's names of inputs."""
    return HistogramRecord(
        inputs=tuple(names.get(x, x) for x in counted.inputs),
        counts=dict(counted.counts),
        shuffled=counted.referring_by_chance(),
        p_values=counted.p_values,
        operators={kind: dict(used) for kind, used in counted.operators.items()},
        count_p=counted.count_p,
        strength_p=counted.strength_p,
        runs=sum(counted.runs.values()),
        shuffled_runs=sum(counted.shuffled_runs.values()),
        significance=counted.significance,
        significant=tuple(names.get(x, x) for x in counted.significant),
    )


def from_evolution(
    start: Ladder, runs: Sequence[Run], counted: Histogram, origin: Origin, best: CompensationRecord
) -> Report:
    """The models fitted, the best program of every run, and the inputs they refer to.

    start: models of the training poses, the last of which leaves the residual.
    """
    real, null = (removed(runs, shuffled) for shuffled in (False, True))
    names = names_of(start.poses.dataset)
    report = replace(
        build("evolve", start, origin),
        effects=tuple(named_effects(start)),
        histograms=(replace(histogram_record(counted, names), removed=real, shuffled_removed=null),),
        runs=tuple(_run(run, names) for run in runs),
        compensation=replace(best, inputs=tuple(names.get(x, x) for x in best.inputs)),
    )
    return replace(report, verdict=verdict.of_evolution(report))


def compensation(runs: Sequence[Run], problem: Problem) -> CompensationRecord:
    """The outputs of the best program at the training poses, over every input it refers to.

    Of a compensator the shift of the point, mm; of a slot's shape the values before its coefficients.
    """
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


def removed(runs: Sequence[Run], shuffled: bool) -> float | None:
    """Median share of what it is scored by that the best program of a run removes; None without runs."""
    gains = [run.gain for run in runs if run.shuffled == shuffled]
    return fitted.optional(float(np.median(gains))) if gains else None


def _run(run: Run, names: Mapping[str, str]) -> ProgramRecord:
    return ProgramRecord(
        representation=run.representation,
        number=run.number,
        shuffled=run.shuffled,
        program=run.program,
        site=translate(run.site, names),
        gain=fitted.optional(run.gain),
        complexity=run.complexity,
        heldout=None if run.heldout is None else fitted.optional(run.heldout),
        strength=fitted.optional(run.strength),
        evaluations=run.evaluations,
        seconds=run.seconds,
        history={k: tuple(fitted.optional(x) for x in v) for k, v in run.history.items()},
    )
