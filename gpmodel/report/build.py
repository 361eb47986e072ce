"""Build every report of calibration or search from a sequence of fits and the final model."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.further import further_poses, heldout_errors, predicted_errors
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.alternatives import closest_alternatives
from gpmodel.calibration.comparison import HeldOutFit, Step
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.calibration.unmeasured_joints import free_joints
from gpmodel.calibration.unobservable import region_sentences, unobservable_sentences
from gpmodel.families.catalogue import family
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.observation import Orientation, observations
from gpmodel.model.sites import names_of, translate
from gpmodel.model.states import measured_torques
from gpmodel.numerics.least_squares import outlier_limit, root_mean_square
from gpmodel.report import fitted
from gpmodel.report.origin import (
    Origin,
    data_record,
    floor_mm,
    instrument_record,
    mechanism_record,
    positioning,
    repeatability,
    versions,
)
from gpmodel.report.schema import REGISTRATION, Kind, MimicRecord, PredictedRecord, Report, StepRecord
from gpmodel.report.schema_search import PlotRecord, ReadingRecord
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Ladder:
    """Fits of successively larger models to the rows `train` of `poses`, and the final model.

    final: fit to all poses, or to the rows `final_rows`.
    named: effects requested by the user in addition to the standard model, not listed among the parameters.
    saved: the content of model.json; None if no file is written. shipped: index of the step whose model is saved.
    parts: one fit per fold of the step `shipped`, with the held-out poses of the fold; None for a single fit.
    gross: numbers of the outliers of a fit to all poses, if `final` is a fit to the rows `final_rows`.
    """

    poses: Poses
    train: IntArray
    steps: Sequence[Step]
    final: Calibration
    named: tuple[Effect, ...] = ()
    final_rows: IntArray | None = None
    saved: SavedModel | None = None
    shipped: int = -1
    parts: tuple[HeldOutFit, ...] | None = None
    gross: tuple[int, ...] = ()

    @property
    def of_final(self) -> Poses:
        """Dataset to which the final model was fitted."""
        return self.poses if self.final_rows is None else self.poses.subset(self.final_rows)

    @property
    def heldout_fits(self) -> tuple[HeldOutFit, ...]:
        """Fits of the model that is saved, each fit with its held-out poses."""
        held = np.setdiff1d(np.arange(len(self.poses)), self.train)
        if self.parts is not None or not len(held):
            return self.parts or ()
        fit = self.steps[self.shipped].calibration
        return (HeldOutFit(fit, self.poses.subset(self.train), self.poses.subset(held)),)

    def as_predicted(self) -> "Ladder":
        """Return the steps of the calibration, with held-out errors as by `gpmodel predict` for the saved model."""
        parts = self.heldout_fits
        if self.saved is None or not parts:
            return self
        errors, steps = heldout_errors(self.poses, parts, as_measured=True), list(self.steps)
        rows = np.concatenate([part.heldout.dataset.row for part in parts])
        at = np.isin(self.poses.dataset.row, rows)
        steps[self.shipped] = replace(steps[self.shipped], heldout_error=errors[at])
        return replace(self, steps=tuple(steps))

    @property
    def outliers(self) -> IntArray:
        """Numbers of the outliers of the fit to all poses, or of the last fit to training poses."""
        of_final = self.final.outliers if self.final_rows is None else np.array(self.gross, dtype=np.int64)
        return np.union1d(of_final, self.train[self.steps[-1].calibration.outliers])

    @property
    def counts(self) -> Mask:
        """Mask of the poses that enter the stated errors: all poses except the outliers."""
        return np.isin(np.arange(len(self.poses)), self.outliers, invert=True)

    def records(self) -> Iterator[StepRecord]:
        """Yield the errors of the model after each step of the calibration, without outliers."""
        counts = self.counts
        held = np.setdiff1d(np.arange(len(self.poses)), self.train)
        for step in self.steps:
            heldout = held if len(step.heldout_error) == len(held) else np.arange(len(self.poses))
            yield StepRecord(
                step=step.name,
                train=fitted.statistics_mm(step.train_error[counts[self.train]]),
                heldout=fitted.statistics_mm(step.heldout_error[counts[heldout]]),
                rank=step.calibration.effective,
                dropped=step.calibration.dropped,
                effect=step.finding,
            )


def build(kind: Kind, ladder: Ladder, origin: Origin) -> Report:
    """Build the part of a Report that calibrations and searches have in common, with the table's joint names."""
    ladder = ladder.as_predicted()
    poses, steps, final = ladder.poses, ladder.steps, ladder.final
    data, names = poses.dataset, names_of(poses.dataset)
    told = final.freedom + final.rank if free_joints(final.model.mechanism) else None
    floor, source = floor_mm(final, ladder.of_final, origin.noise, told)
    rivals, kinds = closest_alternatives(final, ladder.of_final), [joint.kind for joint in final.model.mechanism.joints]
    plots = fitted.plots(poses, ladder.train, ladder.steps)
    return Report(
        kind=kind,
        command=origin.command,
        versions=versions(),
        seed=origin.seed,
        data=data_record(poses, len(ladder.train), ladder.outliers),
        mechanism=mechanism_record(final.model.mechanism, names),
        ladder=tuple(ladder.records()),
        parameters=fitted.parameters(final, names, frozenset(e.name for e in ladder.named)),
        placement=fitted.placement(final),
        rank_curve=final.rank_curve,
        condition_limit=final.condition_limit,
        status=final.status,
        reason=final.reason,
        sigma_mm=1e3 * final.sigma,
        discrepancy_mm=None if ladder.saved is None else 1e3 * ladder.saved.discrepancy,
        freedom=final.freedom,
        noise_floor_mm=floor,
        noise_from=source,
        instrument=instrument_record(data),
        repeatability=repeatability(data),
        positioning=positioning(poses, ladder.train, ladder.steps),
        further=further_poses(final, ladder.of_final, None if ladder.saved is None else ladder.saved.spread),
        predicted=_predicted(ladder),
        plots=plots,
        hidden=(*(translate(rival.words(kinds), names) for rival in rivals), *_of_the_masses(final, data)),
        readings=(
            *reading_records(poses, final, [[_judged(step.calibration, ladder)] for step in (steps[0], steps[-1])]),
            *orientation_record(plots, final, poses.dataset.row[ladder.outliers].tolist()),
        ),
        unseen=(
            *region_sentences(final, poses, searched=kind == "discover"),
            *unobservable_sentences(observations(data)),
        ),
        mimics=tuple(MimicRecord(translate(r.constant, names), translate(r.candidate.name, names)) for r in rivals),
        seconds=origin.seconds,
    )


def _predicted(ladder: Ladder) -> PredictedRecord | None:
    """Return the errors of `gpmodel predict` with and without instrument errors; None without a saved model."""
    saved, poses = ladder.saved, ladder.poses
    if saved is None:
        return None
    held = [heldout_errors(poses, ladder.heldout_fits, as_measured=way) for way in (True, False)]
    model = [predicted_errors(saved, poses, as_measured=way) for way in (True, False)]
    return PredictedRecord(*(fitted.statistics_mm(errors[ladder.counts]) for errors in (*held, *model)))


OWN_UNIT = {"m": ("mm", 1e3), "rad": ("deg", float(np.degrees(1.0))), "px": ("px", 1.0)}
"""Printed unit of a measurement by its SI unit, and the number of printed units in one SI unit."""


Judged = tuple[Calibration, Poses]
"""A fitted model, and the poses at which its errors are computed."""


def _judged(fit: Calibration, ladder: Ladder) -> Judged:
    """Return a fit with its held-out poses, or with its training poses if none were held out."""
    held = np.setdiff1d(np.arange(len(ladder.poses)), ladder.train)
    return fit, ladder.poses.subset(held if len(held) else ladder.train)


def orientation_record(plots: PlotRecord, final: Calibration, outliers: Collection[int]) -> tuple[ReadingRecord, ...]:
    """Return the RMS angle between measured and modelled orientation, mrad, of the first and of the last model.

    The RMS angle is over held-out poses, or over all poses if none were held out. Without measured orientations the
    record is empty. outliers: row numbers in the table.
    """
    if not plots.turn_mrad:
        return ()
    (_, before), (rows, after) = (plots.turned(name, outliers) for name in (REGISTRATION, "final"))
    noise = 1e3 * final.sigma / final.weights[Orientation.name]
    return (ReadingRecord("orientation", "mrad", rows, before, after, noise),)


def reading_records(poses: Poses, final: Calibration, steps: Sequence[Sequence[Judged]]) -> tuple[ReadingRecord, ...]:
    """Return RMS residuals of the first and the last model and the noise, by kind of measurement.

    Positions alone and orientations have no record. final: fit that states the noise. steps: for each of the two
    models, fits and the poses at which their errors are computed.
    """
    if not poses.dataset.observations and not poses.dataset.distances:
        return ()
    left, out = [_left(step) for step in steps], []
    for kind in observations(poses.dataset):
        if isinstance(kind, Orientation):
            continue  # see orientation_record
        if rows := int(kind.readings.any(axis=1).sum()):
            unit, factor = OWN_UNIT[kind.unit]
            before, after = (factor * by[kind.name] if kind.name in by else None for by in left)
            out.append(ReadingRecord(kind.name, unit, rows, before, after, factor * final.noise_of(kind)))
    return tuple(out)


def _left(judged: Sequence[Judged]) -> dict[str, float]:
    """Return the RMS residual of one measured component by kind of measurement, in SI units, without outliers."""
    left: dict[str, list[Array]] = {}
    for fit, poses in judged:
        error = errors_on(fit, poses)
        observed = observe(fit.model, poses, fit.theta, fit.placement)
        for kind in observed.kinds:
            values = kind.residual(observed.tips, observed.own)[error <= outlier_limit(error)]
            left.setdefault(kind.name, []).append(values[np.isfinite(values)])
    return {name: root_mean_square(np.concatenate(values)) for name, values in left.items() if any(map(len, values))}


def _of_the_masses(final: Calibration, data: Dataset) -> Iterator[str]:
    """State for which masses fitted compliances are valid, if joint loads are computed, not measured."""
    mechanism, families = final.model.mechanism, {family(e.family) for e in final.model.effects if e.family}
    if any(known is not None and known.yields for known in families) and not measured_torques(mechanism, data):
        yield (
            "the compliances hold for the masses of the description and the payload of the table: if the true loads "
            "are twice as large, the compliances are half as large"
        )
