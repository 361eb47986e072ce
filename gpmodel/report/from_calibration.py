"""The Report of a calibration with the effects that were named."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import Errors, Rung, known_rows
from gpmodel.calibration.result import Calibration, errors_on, resolved
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.report import fitted, verdict
from gpmodel.report.origin import Origin, data_record, floor_mm, names_of, ranges, repeatability, versions
from gpmodel.report.quantity import translate
from gpmodel.report.schema import ErrorsMm, MechanismRecord, Report, StepRecord
from gpmodel.report.schema_poses import PlotRecord
from gpmodel.report.schema_search import EffectRecord, TermRecord


@dataclass(frozen=True)
class Calibrated:
    """A ladder of fits to training rows of `poses` and the last model fitted to all of them.

    named: the effects beside the standard model.
    """

    poses: Poses
    train: IntArray
    heldout: IntArray
    rungs: tuple[Rung, ...]
    final: Calibration
    named: tuple[Effect, ...]


def from_calibration(calibrated: Calibrated, origin: Origin) -> Report:
    """Ladder, parameters and named effects, under the table's own names."""
    poses, final = calibrated.poses, calibrated.final
    data = poses.dataset
    names = names_of(data)
    floor, source = floor_mm(data, origin.noise)
    report = Report(
        kind="calibrate",
        command=origin.command,
        versions=versions(),
        seed=origin.seed,
        data=data_record(poses, len(calibrated.train), final),
        mechanism=MechanismRecord(final.model.mechanism.name, tuple(names[j] for j in data.joints)),
        ladder=tuple(_step(rung) for rung in calibrated.rungs),
        effects=tuple(_effect(calibrated, e, names) for e in calibrated.named),
        parameters=fitted.parameters(final, names, frozenset(e.name for e in calibrated.named)),
        placement=fitted.placement(final),
        rank_curve=fitted.rank_curve(final),
        condition_limit=final.condition_limit,
        status=final.status,
        reason=final.reason,
        sigma_mm=1e3 * final.sigma,
        noise_floor_mm=floor,
        noise_from=source,
        repeatability=repeatability(data),
        plots=_plots(calibrated),
        seconds=origin.seconds,
    )
    return replace(report, verdict=verdict.of_calibration(report))


def _step(rung: Rung) -> StepRecord:
    return StepRecord(
        step=rung.step,
        train=_millimetres(rung.train),
        heldout=_millimetres(rung.heldout),
        rank=rung.fit.rank,
        dropped=rung.fit.dropped,
    )


def _millimetres(errors: Errors) -> ErrorsMm:
    return ErrorsMm(*(fitted.optional(1e3 * v) for v in (errors.mean, errors.rms, errors.max)))


def _effect(calibrated: Calibrated, effect: Effect, names: Mapping[str, str]) -> EffectRecord:
    final = calibrated.final
    i = [e.name for e in final.model.effects].index(effect.name)
    kept = bool(final.kept[i])
    poses = resolved(final, calibrated.poses)
    moved = fitted.statistics_mm(fitted.tool_displacement(final, poses, [effect]))
    return EffectRecord(
        name=translate(effect.name, names),
        slot=translate(", ".join(effect.slots), names),
        axis=", ".join(dict.fromkeys(t.axis for t in effect.terms)),
        basis=translate("; ".join(dict.fromkeys(str(t.basis) for t in effect.terms)), names),
        inputs=tuple(names.get(x, x) for x in effect.inputs),
        value=float(final.theta[i]),
        stderr=fitted.optional(final.stderr[i]),
        unit=effect.unit,
        unique_share=float(final.unique_share[i]) if kept else None,
        found_by="named",
        catalogue=effect.family or None,
        kept=kept,
        terms=tuple(
            TermRecord(translate(t.slot, names), t.axis, translate(str(t.basis), names), t.weight) for t in effect.terms
        ),
        correlated_with=fitted.correlations(final, [effect], names),
        tool_rms_mm=moved.rms_mm,
        tool_max_mm=moved.max_mm,
        ranges=ranges(poses.states, effect.inputs, names),
    )


def _plots(calibrated: Calibrated) -> PlotRecord:
    poses, train = calibrated.poses, calibrated.train
    seen, unseen = poses.dataset.subset(train), poses.dataset.subset(calibrated.heldout)
    known = known_rows(seen, unseen)

    def held(fit: Calibration) -> Array:
        errors = np.full(len(unseen), np.nan)
        if len(known):
            errors[known] = errors_on(fit, poses.subset(calibrated.heldout[known]))
        return errors

    return fitted.plots(poses, train, [(r.step, r.fit, r.fit.error, held(r.fit)) for r in calibrated.rungs])
