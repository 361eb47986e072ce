"""Records of a fitted calibration: steps, parameters, registration and tool, errors pose by pose."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.result import Calibration, problem_at, resolved
from gpmodel.mechanism.protocol import closed
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, closing, measured_minus, observe, prepare, turn_error
from gpmodel.model.sites import translate
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.rank import orthonormal, remove, triangle
from gpmodel.numerics.se3 import chain, rotation_vector
from gpmodel.report.schema import REGISTRATION, STANDARD, ErrorsMm, ParameterRecord
from gpmodel.report.schema_search import Correlation, PlotRecord, SideErrors, Vectors
from gpmodel.table.dataset import Dataset

CHAIN_POSES = 300
"""Largest number of poses at which the whole arm is drawn, evenly spaced along the rows."""


def statistics_mm(error: Array) -> ErrorsMm:
    """Return mean, RMS and maximum, mm, of 3-D errors given in m; unknown errors (NaN) are left out."""
    mm = 1e3 * error[np.isfinite(error)]
    if len(mm) == 0:
        return ErrorsMm()
    return ErrorsMm(float(mm.mean()), root_mean_square(mm), float(mm.max()))


def optional(value: float) -> float | None:
    """Return a float for JSON: None if not finite."""
    return float(value) if np.isfinite(value) else None


def finite(values: Array) -> tuple[float | None, ...]:
    """Round numbers to six digits for report.json; a number that is not finite becomes None."""
    return tuple(float(f"{v:.6g}") if np.isfinite(v) else None for v in values.tolist())


def vectors(values: Array) -> Vectors:
    """Round rows of numbers to six digits for report.json; a number that is not finite becomes None."""
    return tuple(finite(row) for row in values)


def correlations(final: Calibration, effects: Sequence[Effect], names: Mapping[str, str]) -> tuple[Correlation, ...]:
    """Return at most eight parameters whose correlation with one of the effects exceeds 0.8 (CORRELATED)."""
    partners = final.partners
    near = [(n, c) for e in effects for n, c in partners.get(e.name, ())]
    return tuple(Correlation(translate(n, names), c) for n, c in near[:8])


def parameters(
    final: Calibration, names: Mapping[str, str], without: frozenset[str] = frozenset()
) -> tuple[ParameterRecord, ...]:
    """Return the report's records of fitted parameters, except for the parameters named in `without`.

    Changes of nonlinear constants and of a fitted payload, which are zero by definition, are left out.
    """
    return tuple(
        ParameterRecord(
            name=translate(effect.name, names),
            value=float(final.theta[i]),
            stderr=optional(final.stderr[i] if final.free[i] else final.prior_errors[i]),
            unit=effect.unit,
            unique_share=float(final.unique_share[i]) if final.free[i] else None,
            kept=bool(final.free[i]),
            correlated_with=correlations(final, [effect], names),
        )
        for i, effect in enumerate(final.model.effects)
        if effect.name not in without and (effect.constant or not final.free[i] or final.theta[i] != 0.0)
    )


def placement(final: Calibration) -> tuple[ParameterRecord, ...]:
    """Return the fitted coordinates of tool point and registration as records, the tool first."""
    ordered = sorted(final.placement_numbers, key=lambda p: not p.name.startswith("tool"))
    return tuple(ParameterRecord(p.name, float(p.value), optional(p.stderr), p.unit) for p in ordered)


def tool_displacements(
    calibration: Calibration | SavedModel, poses: Poses, groups: Sequence[Sequence[Effect]]
) -> tuple[Array, list[Array]]:
    """Return the measured points, m, and their displacement by each group of effects, m and rad.

    The last three components of a displacement are the rotation of the tool. All vectors are in the root frame, at
    poses at which kinematic loops close with all effects and without each group.
    """
    model, names = calibration.model, [{e.name for e in group} for group in groups]
    without = [np.where([e.name in own for e in model.effects], 0.0, calibration.theta) for own in names]
    if closed(model.mechanism):
        for theta in (calibration.theta, *without):
            poses = prepare(model.mechanism, poses.dataset.subset(closing(model, poses.dataset, theta)))
    roots = calibration.placement.roots(poses.dataset)
    whole, *less = (
        np.linalg.inv(roots) @ observe(model, poses, theta, calibration.placement).tip
        for theta in (calibration.theta, *without)
    )
    points, turned = whole[:, :3, 3], whole[:, :3, :3]
    return points, [
        np.hstack([points - tips[:, :3, 3], rotation_vector(turned @ tips[:, :3, :3].transpose(0, 2, 1))])
        for tips in less
    ]


def of_specification(effects: Sequence[Effect], moved: ErrorsMm, data: Dataset) -> float | None:
    """Return the size of an instrument error relative to its specification, RMS over the poses.
    An effect of the mechanism, or of an instrument without specification, gives None."""
    if data.instrument is None or moved.rms_mm is None or not all(e.of_the_instrument for e in effects):
        return None
    return moved.rms_mm / (1e3 * data.instrument.at(data.position))


def unabsorbed_rms(fit: Calibration, poses: Poses, groups: Sequence[Sequence[Effect]]) -> list[float | None]:
    """Return the RMS displacement, mm, by each group of effects that nothing else in the model absorbs.

    The RMS is over the displacement minus its projection on the columns of all other unknowns, with registration and
    tool. The RMS is None with unmeasured joints, which absorb a part at every pose, and without measured points.
    """
    problem = problem_at(replace(fit, noise_shape=None), poses)
    point = np.nonzero(problem.weights > 0)[1] < 3
    if problem.reduced is not None or not point.any():
        return [None] * len(groups)
    columns = triangle(problem.columns[point])
    held = problem.free(fit.free)
    theta = np.concatenate([np.zeros(problem.placement), fit.theta])
    out: list[float | None] = []
    for group in groups:
        names = {e.name for e in group}
        own = np.concatenate([np.zeros(problem.placement, dtype=bool), [e.name in names for e in fit.model.effects]])
        left = remove(orthonormal(columns[:, held & ~own]), columns[:, own] @ theta[own])
        out.append(float(1e3 * np.sqrt(np.sum(left**2) / len(poses))))
    return out


def root_residual(calibration: Calibration, poses: Poses) -> Array:
    """Return measured minus modelled position in the root frame, m.
    The position difference is NaN without a measurement, or for a set-up or tool that was not calibrated."""
    out = np.full((len(poses), 3), np.nan)
    known = _known(calibration, poses)
    seen = resolved(calibration, poses.subset(known))
    data = seen.dataset
    observed = observe(calibration.model, seen, calibration.theta, calibration.placement)
    residual = measured_minus(observed, data)[:, :3]
    turn = calibration.placement.roots(data)[:, :3, :3]
    out[known] = (np.swapaxes(turn, 1, 2) @ residual[:, :, None])[:, :, 0]
    return out


def turns(fits: Sequence[tuple[Calibration, Poses]], poses: Poses) -> Array:
    """Return the angle between measured and modelled orientation of each pose, rad, by the fit listed with the pose.
    Orientation errors are NaN without a measured orientation, or for a set-up or tool that was not calibrated."""
    out = np.full(len(poses), np.nan)
    for fit, some in fits:
        seen = resolved(fit, some.subset(_known(fit, some)))
        observed = observe(fit.model, seen, fit.theta, fit.placement)
        out[np.isin(poses.dataset.row, seen.dataset.row)] = turn_error(observed, seen.dataset)
    return out


def _known(calibration: Calibration, poses: Poses) -> IntArray:
    data, placement = poses.dataset, calibration.placement
    here = (("setup", placement.registration), ("tool", placement.tool))
    return np.flatnonzero(np.all([np.isin(data.label(column), list(known)) for column, known in here], axis=0))


def plots(poses: Poses, train: IntArray, steps: Sequence[Step]) -> PlotRecord:
    """Return errors and residuals pose by pose, for the models fitted to the rows `train`."""
    heldout = ~np.isin(np.arange(len(poses)), train)
    fits = {step.name: step.calibration for step in steps}
    last = steps[-1].calibration
    shown = {n: fits[n] for n in (REGISTRATION, STANDARD) if n in fits} | {"final": last}
    drawn = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), CHAIN_POSES)).astype(int))
    arms = 1e3 * chain(poses.transforms[:, drawn])[:, :, :3, 3]
    return PlotRecord(
        rows=tuple(poses.dataset.row.tolist()),
        points_mm=vectors(1e3 * np.column_stack([poses.states[a] for a in "xyz"])),
        heldout_mask=tuple(heldout.tolist()),
        residual_mm={name: vectors(1e3 * root_residual(fit, poses)) for name, fit in shown.items()},
        turn_mrad={name: finite(1e3 * turns([(fit, poses)], poses)) for name, fit in shown.items()}
        if poses.dataset.has_rotation
        else {},
        error_mm={s.name: SideErrors(finite(1e3 * s.train_error), finite(1e3 * s.heldout_error)) for s in steps},
        slots=tuple(last.model.mechanism.slots),
        chain_poses=tuple(drawn.tolist()),
        chain_mm=tuple(vectors(np.round(arm, 2)) for arm in np.swapaxes(arms, 0, 1)),
    )
