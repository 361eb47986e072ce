"""Families of effects that follow the session: temperature, time, and what was moved between two rows."""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate, one
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.effect import Effect, Term, axis_unit, drive_effect, effect_at
from gpmodel.model.states import States

MOST_STEPS = 200


def _temperatures(states: States) -> list[str]:
    return [c for c in states.columns if states.units[c] in ("degC", "K", "kelvin", "celsius", "degF", "°C")]


def _steps(states: States) -> list[int]:
    rows = np.sort(states["row"])
    if len(rows) < 10:
        return []
    stride = max(1, len(rows) // MOST_STEPS)
    return [int(r) for r in rows[4:-4:stride]]


def _moved_once(what: str, slot: str, axes: tuple[str, ...], family: str, states: States) -> Iterator[Candidate]:
    """A step after a row, along each axis and along all of them together."""
    rows = _steps(states)
    for row in rows:
        name, basis = f"{what} after row {row}", Expression(f"step(row - {row}.5)")
        effects = tuple(effect_at(f"{name}, {axis}", slot, axis, basis, family=family) for axis in axes)
        yield Candidate(name, effects, family, 3.0 + np.log(len(rows)))
        for effect in effects:
            yield one(effect.name, effect, 3.0 + np.log(len(axes) * len(rows)))


def _along(slot: str, link: Array, basis: Expression) -> tuple[Term, ...]:
    """A stretch of a link, its vector (3,) in the slot's frame, m."""
    return tuple(Term(slot, f"T{a}", basis, float(v)) for a, v in zip("xyz", link, strict=True) if abs(v) > 1e-9)


def thermal_growth(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    rest = mechanism.transforms(np.zeros((1, len(mechanism.joints))))[:, 0, :3, :]
    lengths = {slot: f[:, :3].T @ f[:, 3] for slot, f in zip(mechanism.slots[1:], rest[1:], strict=True)}
    for column in _temperatures(states):
        unit = f"1/{states.units[column]}"
        along = {slot: _along(slot, link, Expression(column)) for slot, link in lengths.items()}
        name = f"thermal growth of the arm ({column})"
        yield one(name, Effect(name, tuple(chain(*along.values())), unit, "thermal_growth"), 4.0)
        for slot, terms in along.items():
            if np.linalg.norm(lengths[slot]) > 0.02:
                name = f"thermal growth of the link before {slot} ({column})"
                yield one(name, Effect(name, terms, unit, "thermal_growth"), 5.0)


def thermal_zero(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for column in _temperatures(states):
        for j in mechanism.joints:
            effect = drive_effect(
                f"thermal drift of the zero, {j.name} ({column})", j, Expression(column), family="thermal_zero"
            )
            yield one(effect.name, effect, 5.0)


def drift(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    name, row = "drift of the set-up", Expression("row")
    along = [effect_at(f"{name}, {a}", "base", a, row, f"{axis_unit(a)}/row", "drift") for a in AXES]
    yield Candidate(name, tuple(along[:3]), "drift", 4.5)
    for effect in along:
        yield one(effect.name, effect, 4.5)


def setup_step(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    yield from _moved_once("set-up moved", "base", AXES, "set_up_step", states)


def tool_slip(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    yield from _moved_once("tool slipped", "tool", AXES[:3], "tool_slip", states)


def warm_up(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    span = float(np.ptp(states["row"])) or 1.0
    for share in (0.05, 0.1, 0.2, 0.4):
        basis = Expression(f"exp(-row/{share * span:.4g})")
        for j in mechanism.joints:
            name = f"warm-up of the zero, {j.name}"
            yield one(name, drive_effect(name, j, basis, family="warm_up"), 7.0)
        for axis in AXES:
            name = f"warm-up of the set-up, {axis}"
            yield one(name, effect_at(name, "base", axis, basis, family="warm_up"), 7.0)
