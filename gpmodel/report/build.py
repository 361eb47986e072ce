"""What every report says, whatever call made it: the one builder, of a ladder of fits and the model that is shipped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.calibration.rivals import hidden_rivals
from gpmodel.calibration.unmeasured_joints import free_joints
from gpmodel.calibration.unseen import unseen
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.naming import names_of, translate
from gpmodel.model.observation import observations
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.outliers import outlier_limit
from gpmodel.report import fitted
from gpmodel.report.iso9283 import positioning, repeatability
from gpmodel.report.origin import (
    Origin,
    data_record,
    floor_mm,
    instrument_record,
    mechanism_record,
    versions,
)
from gpmodel.report.schema import Kind, MimicRecord, Report, StepRecord
from gpmodel.report.schema_poses import ReadingRecord


@dataclass(frozen=True)
class Ladder:
    """Fits to the rows `train` of `poses`, one after the other, and the model to ship, fitted to all of them.

    named: effects beside the standard model that were asked for; they are no parameters of it.
    """

    poses: Poses
    train: IntArray
    steps: Sequence[Step]
    final: Calibration
    named: tuple[Effect, ...] = ()


def build(kind: Kind, ladder: Ladder, origin: Origin) -> Report:
    """The part of a Report that every call has, under the table's own names; each adds what is its own."""
    poses, final = ladder.poses, ladder.final
    data, names = poses.dataset, names_of(poses.dataset)
    told = final.freedom + final.rank if free_joints(final.model.mechanism) else None
    floor, source = floor_mm(data, origin.noise, told)
    rivals, kinds = hidden_rivals(final, poses), [joint.kind for joint in final.model.mechanism.joints]
    return Report(
        kind=kind,
        command=origin.command,
        versions=versions(),
        seed=origin.seed,
        data=data_record(poses, len(ladder.train), final),
        mechanism=mechanism_record(final.model.mechanism, names),
        ladder=tuple(_step(step) for step in ladder.steps),
        parameters=fitted.parameters(final, names, frozenset(e.name for e in ladder.named)),
        placement=fitted.placement(final),
        rank_curve=fitted.rank_curve(final),
        condition_limit=final.condition_limit,
        status=final.status,
        reason=final.reason,
        sigma_mm=1e3 * final.sigma,
        freedom=final.freedom,
        noise_floor_mm=floor,
        noise_from=source,
        instrument=instrument_record(data),
        repeatability=repeatability(data),
        positioning=positioning(poses, ladder.train, ladder.steps),
        further=fitted.further(final, poses),
        plots=fitted.plots(poses, ladder.train, ladder.steps),
        hidden=tuple(translate(rival.words(kinds), names) for rival in rivals),
        readings=reading_records(ladder),
        unseen=tuple(unseen(observations(data))),
        mimics=tuple(MimicRecord(translate(r.constant, names), translate(r.candidate.name, names)) for r in rivals),
        seconds=origin.seconds,
    )


OWN_UNIT = {"m": ("mm", 1e3), "rad": ("deg", float(np.degrees(1.0))), "px": ("px", 1.0)}
"""How readings are written, and how many there are in one of SI."""


def reading_records(ladder: Ladder) -> tuple[ReadingRecord, ...]:
    """What the first and the last step leave of each kind of reading; none of a table of points alone."""
    poses = ladder.poses
    if not poses.dataset.observations:
        return ()
    held = np.setdiff1d(np.arange(len(poses)), ladder.train)
    judged = poses.subset(held if len(held) else ladder.train)
    left = [_left(step.calibration, judged) for step in (ladder.steps[0], ladder.steps[-1])]
    out = []
    for kind in observations(poses.dataset):
        if rows := int(kind.readings.any(axis=1).sum()):
            unit, factor = OWN_UNIT[kind.unit]
            before, after = (factor * by[kind.name] if kind.name in by else None for by in left)
            out.append(ReadingRecord(kind.name, unit, rows, before, after))
    return tuple(out)


def _left(fit: Calibration, poses: Poses) -> dict[str, float]:
    """RMS of a component by kind, in its own unit; readings that stand far out are left away, as in the fit."""
    error = errors_on(fit, poses)
    poses = poses.subset(np.flatnonzero(error <= outlier_limit(error)))
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    left = {kind.name: kind.residual(observed.tips, observed.own) for kind in observed.kinds}
    return {n: root_mean_square(v[np.isfinite(v)]) for n, v in left.items() if np.isfinite(v).any()}


def _step(step: Step) -> StepRecord:
    return StepRecord(
        step=step.name,
        train=fitted.statistics_mm(step.train_error),
        heldout=fitted.statistics_mm(step.heldout_error),
        rank=step.calibration.rank,
        dropped=step.calibration.dropped,
        effect=step.finding,
    )
