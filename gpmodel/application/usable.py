"""What of a saved model is used for poses that nobody measured, and where it is used beyond its ranges."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.calibration.result import Covariance
from gpmodel.formula.expression import Basis, Columns
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.states import States
from gpmodel.table.units import is_time

MARGIN = 0.01
"""Share of a range's width by which an input may lie outside it unsaid: the extremes of a sample of poses are about
one part in its number short of the limits the poses were drawn from."""
SHAPES = ("", "joint_curve")
"""Families that say how an effect looks over the measured poses and not why: beyond those they say nothing."""


@dataclass(frozen=True)
class Clamped:
    """A basis whose inputs stay within the ranges it was fitted in: beyond them it keeps its value at the edge."""

    basis: Basis
    ranges: Mapping[str, tuple[float, float]]

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.basis.inputs

    def __call__(self, states: Columns) -> Array:
        return self.basis(_Within(states, self.ranges))

    def __str__(self) -> str:
        return str(self.basis)


@dataclass(frozen=True)
class _Within:
    states: Columns
    ranges: Mapping[str, tuple[float, float]]

    def __getitem__(self, name: str) -> Array:
        return np.clip(self.states[name], *self.ranges[name]) if name in self.ranges else self.states[name]

    def __len__(self) -> int:
        return len(self.states)


def of_the_session(saved: SavedModel) -> tuple[Effect, ...]:
    """Effects that read the row number or a time: what they say belongs to the session that was fitted."""
    clocks = {"row", *(name for name, unit in saved.input_units.items() if is_time(unit))}
    return tuple(effect for effect in saved.model.effects if clocks & set(effect.inputs))


def usable(saved: SavedModel, *, session: bool = False) -> SavedModel:
    """The model for other poses: what reads the session is left out unless `session`, and a law that nobody named is
    clamped, so that beyond the ranges of its inputs it keeps its value at the edge."""
    left_out = () if session else of_the_session(saved)
    found = _without(saved, left_out)
    effects = tuple(_clamped(effect, saved.ranges) for effect in found.model.effects)
    return replace(found, model=ErrorModel(saved.mechanism, effects))


def of_the_mechanism(saved: SavedModel) -> SavedModel:
    """The model without the errors of the instrument, which move what is read and not the tool."""
    kept = saved.model.of_the_mechanism(saved.theta)[0].effects
    return _without(saved, tuple(effect for effect in saved.model.effects if effect not in kept))


def _without(saved: SavedModel, left_out: tuple[Effect, ...]) -> SavedModel:
    kept = np.array([effect not in left_out for effect in saved.model.effects], dtype=bool)
    rows = np.concatenate([np.ones(len(saved.covariance.placement), dtype=bool), kept])
    effects = tuple(effect for effect in saved.model.effects if effect not in left_out)
    covariance = saved.covariance
    reads = {name for effect in effects for name in effect.inputs}
    lags = any(name.startswith("lag_") for name in reads)
    unread = {name for effect in left_out for name in effect.inputs if not lags} - reads
    return replace(
        saved,
        model=ErrorModel(saved.mechanism, effects),
        theta=saved.theta[kept],
        stderr=saved.stderr[kept],
        covariance=Covariance(covariance.values[np.ix_(rows, rows)], covariance.placement, covariance.centre),
        input_units={k: v for k, v in saved.input_units.items() if k not in unread},
    )


def _clamped(effect: Effect, ranges: Mapping[str, tuple[float, float]]) -> Effect:
    if effect.constant or effect.family not in SHAPES:
        return effect
    return replace(effect, terms=tuple(replace(t, basis=Clamped(t.basis, ranges)) for t in effect.terms))


def outside(saved: SavedModel, states: States) -> tuple[str, ...]:
    """Of each pose, the inputs of the model beyond the ranges it was fitted in, as text; empty where there are none."""
    read = {name for effect in saved.model.effects for name in effect.inputs}
    words = np.full(len(states), "", dtype=object)
    for name, (low, high) in saved.ranges.items():
        if name in read or name in {joint.name for joint in saved.mechanism.joints}:
            margin = MARGIN * (high - low) + 1e-9
            beyond = (states[name] < low - margin) | (states[name] > high + margin)
            words[beyond] = [f"{word} {name}".strip() for word in words[beyond]]
    return tuple(words.tolist())
