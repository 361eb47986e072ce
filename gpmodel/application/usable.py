"""Parts of a saved model that apply at unmeasured poses, and warnings outside the model's fitted ranges."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array, Mask
from gpmodel.families.by_name import check_defined
from gpmodel.families.catalogue import family
from gpmodel.formula.expression import Basis, Columns
from gpmodel.mechanism.branches import branched, random_poses
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe
from gpmodel.model.states import States
from gpmodel.numerics import se3
from gpmodel.table.units import clock_names

MARGIN = 0.01
"""Share of an input's fitted range by which the input may exceed the range without a warning. The extremes of N poses
fall short of the joint limits by about 1/N."""

REACHES = (0.1, 0.05)
"""Shares of an input's fitted range by which a formula outside the catalogue is extrapolated: the first share if the
formula is steady within the share, else the second, else none. Between 20 or 40 poses a share as large is unsampled."""
LOOKS = 400
"""Number of points at which a formula's steadiness is tested within its input ranges, and beyond each edge."""


@dataclass(frozen=True)
class Clamped:
    """Basis function with inputs clipped to ranges, so that the function is constant beyond the ranges."""

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


@dataclass(frozen=True)
class Ended:
    """Basis function with row number and time fixed at the end of a session. clocks: last row number and last times."""

    basis: Basis
    clocks: Mapping[str, float]

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(name for name in self.basis.inputs if name not in self.clocks)

    @property
    def constant(self) -> float | None:
        """Value at the end of the session if the basis function depends on row number and time alone, else None."""
        return None if self.inputs else float(self({"": np.zeros(1)})[0])

    def __call__(self, states: Columns) -> Array:
        return self.basis(_At(states, self.clocks))

    def __str__(self) -> str:
        return str(self.basis)


@dataclass(frozen=True)
class _At:
    states: Columns
    moment: Mapping[str, float]

    def __getitem__(self, name: str) -> Array:
        return np.full(len(self), self.moment[name]) if name in self.moment else self.states[name]

    def __len__(self) -> int:
        return len(self.states)


def session_effects(saved: SavedModel) -> tuple[Effect, ...]:
    """Return the effects that depend on the row number or a time, and therefore only describe the fitted session."""
    clocks = clock_names(saved.input_units)
    return tuple(effect for effect in saved.model.effects if clocks & set(effect.inputs))


def persists(effect: Effect) -> bool:
    """Return whether an effect persists after the measured session; errors of the instrument and reversible drift do
    not."""
    known = family(effect.family)
    return not effect.of_the_instrument and not (known and known.wanders)


def usable(saved: SavedModel, *, session: bool = False, as_measured: bool = False) -> SavedModel:
    """Return a model for new poses: at the end of the fitted session, without the errors of the instrument.

    A formula outside the catalogue is constant beyond the ranges of its inputs, and so is a creep of the set-up after
    the session. A reversible drift of set-up or instrument is omitted after the session.
    as_measured: True to keep errors of the instrument other than drift. session: True to keep all effects, for rows of
    the fitted session.
    """
    found = saved if session else _after_the_session(saved)
    found = found if session or as_measured else without_instrument(found)
    effects = tuple(_clamped(effect, saved.ranges) for effect in found.model.effects)
    others = tuple(_clamped(effect, saved.ranges) for effect in found.covariance.alternatives)
    covariance = replace(found.covariance, alternatives=others)
    return replace(found, model=ErrorModel(saved.mechanism, effects), covariance=covariance)


def at_end(saved: SavedModel) -> SavedModel:
    """Return a model with registration and tool as at the end of the fitted session.

    A slip of the tool or a move of the set-up becomes part of tool and registration, so that compensated joint values
    do not correct it.
    """
    slots, effects = saved.mechanism.slots, saved.model.effects
    ends = ((slots[0],), (slots[-1],))
    ended = (e.constant and e.slots in ends and all(isinstance(t.basis, Ended) for t in e.terms) for e in effects)
    own = np.fromiter(ended, dtype=bool)
    if branched(saved.mechanism) or not own.any():
        return saved
    at, (robot, tool) = States({"": np.zeros(1)}, {"": "1"}), np.zeros((2, 1, 6))
    for k in np.flatnonzero(own):
        robot += saved.theta[k] * effects[k].twist(at, slots[0])
        tool += saved.theta[k] * effects[k].twist(at, slots[-1])
    root = saved.mechanism.transforms(random_poses(saved.mechanism, 1, np.random.default_rng(0)))[0, 0]
    moved = root @ se3.exp(robot)[0] @ np.linalg.inv(root)
    placed = Placement(
        {name: frame @ moved for name, frame in saved.placement.registration.items()},
        {name: se3.exp(tool)[0] @ frame for name, frame in saved.placement.tool.items()},
        saved.placement.anchors,
    )
    return replace(_only(saved, ~own), placement=placed)


def _after_the_session(saved: SavedModel) -> SavedModel:
    clocks = {name: saved.ranges[name][1] for name in clock_names(saved.input_units) if name in saved.ranges}
    own = session_effects(saved)
    saved = _only(saved, np.array([e not in own or persists(e) for e in saved.model.effects], dtype=bool))
    effects = tuple(
        replace(effect, terms=tuple(replace(t, basis=Ended(t.basis, clocks)) for t in effect.terms))
        if effect in own
        else effect
        for effect in saved.model.effects
    )
    model = ErrorModel(saved.mechanism, effects)
    return replace(saved, model=model, input_units=_still_read(saved, model))


def check_finite(saved: SavedModel, poses: Poses) -> None:
    """Raise InputError naming the effect if its basis function is infinite or undefined at a pose."""
    poses = replace(poses, dataset=replace(poses.dataset, distances={}, observations=()))
    own, theta = saved.model.of_the_mechanism(saved.theta)
    for effect in own.effects:
        check_defined(effect, saved.mechanism, poses.states)
    if of_the_instrument := [effect for effect in saved.model.effects if effect.of_the_instrument]:
        seen = poses.states.seen_at(observe(own, poses, theta, saved.placement).tip[:, :3, 3])
        for effect in of_the_instrument:
            check_defined(effect, saved.mechanism, seen)


def without_instrument(saved: SavedModel) -> SavedModel:
    """Return the model without the errors of the instrument, which change measurements but not the tool's position."""
    return _only(saved, np.array([not effect.of_the_instrument for effect in saved.model.effects], dtype=bool))


def _only(saved: SavedModel, kept: Mask) -> SavedModel:
    """Return the model with the effects selected by the mask `kept`."""
    model = ErrorModel(saved.mechanism, tuple(saved.model.effects[i] for i in np.flatnonzero(kept)))
    return replace(
        saved,
        model=model,
        theta=saved.theta[kept],
        stderr=saved.stderr[kept],
        covariance=saved.covariance.subset(kept),
        input_units=_still_read(saved, model),
    )


def _still_read(saved: SavedModel, model: ErrorModel) -> dict[str, str]:
    """Return the units of the columns that a smaller model needs; all columns if an effect has a lag in time."""
    before, reads = ({name for effect in m.effects for name in effect.inputs} for m in (saved.model, model))
    unread = set() if any(name.startswith("lag_") for name in reads) else before - reads
    return {name: unit for name, unit in saved.input_units.items() if name not in unread}


def _clamped(effect: Effect, ranges: Mapping[str, tuple[float, float]]) -> Effect:
    known = family(effect.family)
    if effect.constant or (effect.family and not (known and known.clamped)):
        return effect
    return replace(effect, terms=tuple(replace(t, basis=_clamped_basis(t.basis, ranges)) for t in effect.terms))


def _clamped_basis(basis: Basis, ranges: Mapping[str, tuple[float, float]]) -> Clamped:
    """Return a basis function held constant beyond its inputs' fitted ranges, slightly widened if no pole is near."""
    own = {name: ranges[name] for name in basis.inputs if name in ranges}
    if own and len(own) == len(basis.inputs):
        for reach in REACHES:
            wider = {
                name: (low - reach * (high - low), high + reach * (high - low)) for name, (low, high) in own.items()
            }
            if _is_steady(basis, own, wider):
                return Clamped(basis, wider)
    return Clamped(basis, own)


def _is_steady(basis: Basis, own: Mapping[str, tuple[float, float]], wider: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether a basis function changes beyond its input ranges by less than half of its change within them."""
    count = max(3, round(LOOKS ** (1.0 / len(own))))
    ends = ((wider[name][0], low, high, wider[name][1]) for name, (low, high) in own.items())
    values = [np.concatenate([np.linspace(a, b, count) for a, b in pairwise(four)]) for four in ends]
    at = States(dict(zip(own, map(np.ravel, np.meshgrid(*values, indexing="ij")), strict=True)), dict.fromkeys(own, ""))
    with np.errstate(all="ignore"):
        beyond, within = Clamped(basis, wider)(at), Clamped(basis, own)(at)
    return bool(np.abs(beyond - within).max() < 0.5 * np.ptp(within))


def out_of_range(saved: SavedModel, states: States) -> tuple[str, ...]:
    """List, for each pose, the inputs outside their fitted ranges, by their names in the table; empty if all are
    inside."""
    read = {name for effect in saved.model.effects for name in effect.inputs}
    words, called = np.full(len(states), "", dtype=object), saved.names
    for name, (low, high) in saved.ranges.items():
        if name in read or name in {joint.name for joint in saved.mechanism.joints}:
            margin = MARGIN * (high - low) + 1e-9
            beyond = (states[name] < low - margin) | (states[name] > high + margin)
            words[beyond] = [f"{word} {called.get(name, name)}".strip() for word in words[beyond]]
    return tuple(words.tolist())
