"""The Report of programs evolved on the residual of a fitted model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.problems import COORDINATES, CartesianProblem, Problem
from gpmodel.evolution.runs import Run
from gpmodel.formula.parse import parse
from gpmodel.model.sites import names_of, translate
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.effects import named_effects
from gpmodel.report.origin import Origin
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CompensationRecord


def in_the_table(counted: Histogram, names: Mapping[str, str]) -> Histogram:
    """Rename the inputs as the table does."""
    return replace(counted, inputs=tuple(names.get(x, x) for x in counted.inputs))


def from_evolution(
    start: Ladder, runs: Sequence[Run], counted: Histogram, origin: Origin, best: CompensationRecord
) -> Report:
    """The models fitted, the best program of every run, and the inputs they refer to.

    start: models of the training poses, the last of which leaves the residual.
    """
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
