"""The Report of compensators evolved on what a fitted model leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import step_of
from gpmodel.calibration.result import Calibration
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.runs import Run
from gpmodel.model.error_model import Poses
from gpmodel.model.naming import names_of, translate
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.origin import Origin
from gpmodel.report.schema import STANDARD, Report
from gpmodel.report.schema_search import HistogramRecord, ProgramRecord


def histogram_record(counted: Histogram, names: Mapping[str, str]) -> HistogramRecord:
    """What a report keeps of a histogram; `names` are the table's names of inputs."""
    return HistogramRecord(
        inputs=tuple(names.get(x, x) for x in counted.inputs),
        counts=dict(counted.counts),
        shuffled=counted.referring_by_chance(),
        p_values=counted.p_values,
        count_p=counted.count_p,
        strength_p=counted.strength_p,
        runs=sum(counted.runs.values()),
        shuffled_runs=sum(counted.shuffled_runs.values()),
        significance=counted.significance,
        significant=tuple(names.get(x, x) for x in counted.significant),
    )


def from_evolution(
    fit: Calibration, poses: Poses, train: IntArray, evolved: tuple[Sequence[Run], Histogram], origin: Origin
) -> Report:
    """The fit, the best program of every run, and the inputs they refer to.

    fit: of the training rows of `poses`. evolved: the finished runs and their histogram of referenced inputs.
    """
    runs, counted = evolved
    real, null = (removed(runs, shuffled) for shuffled in (False, True))
    names = names_of(poses.dataset)
    unseen = poses.subset(np.setdiff1d(np.arange(len(poses)), train))
    step = step_of(STANDARD, fit, poses.subset(train), unseen)
    report = replace(
        build("evolve", Ladder(poses, train, (step,), fit, final_rows=train), origin),
        histograms=(replace(histogram_record(counted, names), removed=real, shuffled_removed=null),),
        runs=tuple(_run(run, names) for run in runs),
    )
    return replace(report, verdict=verdict.of_evolution(report))


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
