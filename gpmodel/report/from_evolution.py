"""The Report of compensators evolved on what a fitted model leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.runs import Run
from gpmodel.model.error_model import Poses
from gpmodel.report import fitted, verdict
from gpmodel.report.origin import Origin, data_record, floor_mm, names_of, versions
from gpmodel.report.quantity import translate
from gpmodel.report.referenced import histogram_record
from gpmodel.report.schema import STANDARD, MechanismRecord, Report, StepRecord
from gpmodel.report.schema_search import ProgramRecord


def from_evolution(
    fit: Calibration, poses: Poses, train: IntArray, evolved: tuple[Sequence[Run], Histogram], origin: Origin
) -> Report:
    """The fit, the best program of every run, and the inputs they refer to.

    fit: of the training rows of `poses`. evolved: the finished runs and their histogram of referenced inputs.
    """
    runs, counted = evolved
    data = poses.dataset
    names = names_of(data)
    heldout = np.setdiff1d(np.arange(len(poses)), train)
    unseen = errors_on(fit, poses.subset(heldout)) if len(heldout) else np.zeros(0)
    floor, source = floor_mm(data, origin.noise)
    report = Report(
        kind="evolve",
        command=origin.command,
        versions=versions(),
        seed=origin.seed,
        data=data_record(poses, len(train), fit),
        mechanism=MechanismRecord(fit.model.mechanism.name, tuple(names[j] for j in data.joints)),
        ladder=(
            StepRecord(STANDARD, fitted.statistics_mm(fit.error), fitted.statistics_mm(unseen), fit.rank, fit.dropped),
        ),
        histograms=(histogram_record(counted, names),),
        runs=tuple(_run(run, names) for run in runs),
        parameters=fitted.parameters(fit, names),
        placement=fitted.placement(fit),
        rank_curve=fitted.rank_curve(fit),
        condition_limit=fit.condition_limit,
        status=fit.status,
        reason=fit.reason,
        sigma_mm=1e3 * fit.sigma,
        noise_floor_mm=floor,
        noise_from=source,
        plots=fitted.plots(poses, train, [(STANDARD, fit, fit.error, unseen)]),
        seconds=origin.seconds,
    )
    return replace(report, verdict=verdict.of_evolution(report))


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
