"""Errors of a fitted model at inputs and payloads beyond the fitted ranges."""

from collections.abc import Iterator, Sequence

import numpy as np

from gpmodel.application.kinematics import with_model_labels
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import without_outliers
from gpmodel.calibration.linearise import Linearised, Weighting, linearise
from gpmodel.calibration.unmeasured_joints import without_eliminated
from gpmodel.families.catalogue import candidates
from gpmodel.families.load import moments_at_tool
from gpmodel.mechanism.source import choice_of
from gpmodel.model.error_model import Placement, Poses, prepare
from gpmodel.table.units import clock_names


def columns_beyond(saved: SavedModel, poses: Poses) -> set[str]:
    """Return the columns of a later table that are inputs of the model and exceed the range of its fit."""
    read = {name for effect in saved.model.effects for name in effect.inputs} - clock_names(saved.input_units)
    extras = poses.dataset.extras
    return {
        name
        for name in read & set(extras) & set(saved.ranges)
        if extras[name].min() < saved.ranges[name][0] or extras[name].max() > saved.ranges[name][1]
    }


def extrapolated(saved: SavedModel, fitted: Placement, problem: Linearised) -> Array:
    """Return the errors, m, of one standard deviation that unknowns cause at later rows beyond the ranges of the fit,
    one column per unknown; no columns within the ranges.

    Derivatives are h for an effect and F for the fitted parameters at the fitted rows, and g, G at later rows. The fit
    determines the effect to ± σ/|h - F b|; F b is the part of h along F, σ the noise. The effect moves later rows by g
    - G b. Only catalogue effects with an input beyond its fitted range cause errors. The unstated centre of mass of a
    payload beyond the range is taken to lie within the lever of the tool point.
    """
    return np.column_stack(
        [np.zeros((len(problem.residual), 0)), *_unlearned(saved, fitted, problem), *_carried(saved, problem)]
    )


def rows_of_the_fit(saved: SavedModel, placement: Placement) -> Linearised | None:
    """Linearise the measurements that a model was fitted to, without their outliers; None if the model has none.

    placement: registration and tool of the fit.
    """
    if saved.measured is None:
        return None
    poses = prepare(saved.mechanism, with_model_labels(saved, saved.measured.dataset))
    here, every = (saved.model, poses, saved.theta, placement), np.ones(len(poses), dtype=bool)
    first = linearise(*here, Weighting(saved.weights, every, saved.noise_shape))
    use = without_outliers(first.observed, poses.dataset, every, saved.weights)
    return first if use.all() else linearise(*here, Weighting(saved.weights, use, saved.noise_shape))


def in_order_of(wanted: Sequence[object], names: Sequence[object], columns: Array) -> Array:
    """Return columns (rows, names) in the order of the names `wanted`; zero for a name without a column."""
    by_name, nothing = dict(zip(names, columns.T, strict=True)), np.zeros(len(columns))
    return np.column_stack([by_name.get(name, nothing) for name in wanted])


def _unlearned(saved: SavedModel, placed: Placement, problem: Linearised) -> Iterator[Array]:
    beyond = columns_beyond(saved, problem.poses)
    fit = rows_of_the_fit(saved, placed) if beyond else None
    if fit is None:
        return
    own = {effect.name for effect in saved.model.effects}
    effects = [
        effect
        for candidate in candidates(saved.mechanism, fit.poses.states)
        if candidate.kind == "single"
        for effect in candidate.effects
        if beyond & set(effect.inputs) and effect.name not in own and not effect.of_the_instrument
    ]
    there, before = ([*p.placement_names, *range(len(saved.model.effects))] for p in (problem, fit))
    later = in_order_of(before, there, problem.columns)
    h, g = (p.effect_rows(effects, saved.model) for p in (fit, problem))
    share = np.linalg.lstsq(fit.columns, h, rcond=1e-9)[0]
    left = without_eliminated(h - fit.columns @ share, np.linalg.norm(h, axis=0))
    known = np.linalg.norm(left, axis=0)
    moved = g - later @ share
    yield saved.spread * moved[:, known > 0] / known[known > 0]


def _carried(saved: SavedModel, problem: Linearised) -> Iterator[Array]:
    """Yield the displacement of rows by a payload with a shifted centre of mass, along each axis of the tool."""
    if choice_of(saved.mechanism).payload_com is not None or saved.measured is None:
        return
    known, payload = saved.measured.dataset.payload, problem.poses.dataset.payload
    more = payload - np.clip(payload, known.min(), known.max())
    effects = moments_at_tool(saved.mechanism, problem.poses.states, saved.model.effects, saved.theta)
    if more.any() and effects:
        yield problem.effect_rows(effects, saved.model) * saved.lever * more[problem.pose_of_row, None]
