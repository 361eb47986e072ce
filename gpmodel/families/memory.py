"""Families of effects that remember: play, friction, hysteresis, and what follows the temperature with a lag.

They exist where the rows are in the order of measurement. Magnitudes: play 0.25 to 1 arc minute from side to side (Gong
2000); expansion and what bends by it as in gpmodel.families.session.
"""

from collections.abc import Iterator

import numpy as np

from gpmodel.families.candidate import Candidate, across, inside, loaded, one, relative, revolute
from gpmodel.families.inner import Constant, NonlinearParameters, geometric, symbol
from gpmodel.families.session import EXPANSION, TILT, ZERO, arm_growth, link_growth
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.model.effect import Effect, drive_effect, effect_at
from gpmodel.model.memory import read_by, temperatures
from gpmodel.model.states import States

PLAY = 1e-4
"""Half the play of a drive, rad or, over a pitch radius of 0.1 m, a tenth of it in m."""

WIDTHS = (0.02, 0.05, 0.1, 0.2)
"""Half-widths of stop operators, as shares of a joint's travel or of a torque's span: what is narrower looks like play,
what is wider like a smooth curve."""

LAGS = 8
"""Time constants offered, in equal ratios from a row to the session."""


def _play(joint: Joint) -> float:
    return PLAY if joint.kind == "revolute" else 0.1 * PLAY


def _moving(mechanism: Mechanism, states: States) -> list[Joint]:
    return [j for j in mechanism.joints if states.past and f"last_move_{j.name}" in states.columns]


def play_last_move(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Play of a drive by the direction of its last move, ±1."""
    for j in _moving(mechanism, states):
        name = f"play by the last move, {j.name}"
        basis = Expression(f"last_move_{j.name}")
        yield one(name, drive_effect(name, j, basis, family="play_last_move", prior=_play(j)), 4.0)


def friction_windup(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Wind-up held by friction: the last direction ±1, and that times the size of the torque."""
    for j in _moving(mechanism, states):
        torque = f"torque_{j.name}"
        if loaded(states, torque):
            name = f"friction windup, {j.name}"
            load = f"abs({torque})/{float(np.max(np.abs(states[torque]))):.4g}"
            effects = tuple(
                drive_effect(f"{name}, {part}", j, Expression(basis), family="friction_windup", prior=_play(j))
                for part, basis in (
                    ("constant", f"last_move_{j.name}"),
                    ("with the load", f"last_move_{j.name}*{load}"),
                )
            )
            yield Candidate(name, effects, "friction_windup", 4.5)


def hysteresis(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Stop operators over the path of a joint's angle or torque, of several widths."""
    for j in _moving(mechanism, states):
        for column in (j.name, f"torque_{j.name}"):
            span = float(np.ptp(states.past.columns[column])) if states.past and loaded(states, column) else 0.0
            if span > 0:
                over = "its angle" if column == j.name else "its torque"
                name = f"hysteresis over {over}, {j.name}"
                unit, widths = states.unit(column), [float(f"{share * span:.4g}") for share in WIDTHS]
                constants = tuple(Constant("half-width", unit, w, 0.5 * w, number=k) for k, w in enumerate(widths))
                effects = tuple(
                    drive_effect(
                        f"{name}, within {c.symbol}", j, Expression(f"stop_{column}_{c.symbol}/{c.symbol}"),
                        family="hysteresis", prior=_play(j),
                    )
                    for c in constants
                )  # fmt: skip
                yield inside(NonlinearParameters(name, effects, constants), "hysteresis", 5.0)


def lagged_growth(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Links that grow, axes that tilt and zeros that drift with a temperature they follow late."""
    if states.past is None:
        return
    times = states.past.columns[states.past.clock]
    session = float(np.ptp(times))
    unit = "rows" if states.past.clock == "row" else states.units[states.past.clock]
    for column in temperatures(states.units):
        if read_by(column) or not session * np.ptp(states.past.columns[column]) > 0:
            continue
        lags = tuple(geometric("lag", unit, (max(session / 100, 2 * session / len(times)), session), LAGS))
        kelvin = states.units[column]
        basis = Expression(relative(states, f"lag_{column}_{symbol()}", kelvin))
        where = f"({column}, lag of {symbol()} {unit})"
        for name, effects, cost in _following(mechanism, basis, where, kelvin):
            for lag in lags:
                yield inside(NonlinearParameters(name, effects, (lag,)), "lagged_growth", cost)


def _following(
    mechanism: Mechanism, basis: Expression, where: str, kelvin: str
) -> Iterator[tuple[str, tuple[Effect, ...], float]]:
    """Yield the effects that may follow a temperature, with their cost: all links, each link, the tilt of the base
    and of each axis, each zero.
    """
    family, cost = "lagged_growth", 4.0 + float(np.log(LAGS))
    name = f"growth of the arm {where}"
    yield name, (arm_growth(name, mechanism, basis, f"1/{kelvin}", family, EXPANSION),), cost
    name = f"growth of the link before {{slot}} {where}"
    for effect in link_growth(name, mechanism, basis, f"1/{kelvin}", family, EXPANSION):
        yield effect.name, (effect,), cost + 1.0
    tilting = [("the base", "base", ("x", "y"))]
    tilting += [(j.name, f"{j.name}.moving", across(j)) for j in revolute(mechanism)]
    for what, slot, axes in tilting:
        name = f"tilt of {what} {where}"
        effects = tuple(effect_at(f"{name}, R{a}", slot, f"R{a}", basis, f"rad/{kelvin}", family, TILT) for a in axes)
        yield name, effects, cost + 1.0
    for j in revolute(mechanism):
        name = f"drift of the zero of {j.name} {where}"
        yield name, (drive_effect(name, j, basis, f"rad/{kelvin}", family, ZERO),), cost + 1.0
