"""Families of effects during a measurement session: temperature, time, sudden shifts, and effects with memory.

Effects with memory depend on earlier poses: play, friction, hysteresis and a lag behind the temperature. Effects that
depend on earlier poses need rows in the order of measurement. Typical play is 0.25 to 1 arc minute from side to side
(Gong 2000).
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from gpmodel.families.candidate import Candidate, across, inside, loaded, one, relative, revolute, share_of_rows
from gpmodel.families.inner import Constant, NonlinearParameters, geometric, symbol
from gpmodel.formula.expression import Basis, Expression
from gpmodel.mechanism.branches import links
from gpmodel.mechanism.protocol import AXES, Joint, Mechanism
from gpmodel.model.effect import Effect, Term, axis_unit, drive_effect, effect_at
from gpmodel.model.memory import constant_of, declared_approach, read_by, temperatures
from gpmodel.model.states import States

EXPANSION = 2e-5
"""Typical thermal expansion of a link, 1/K: between steel, 12e-6, and aluminium, 23e-6."""

TILT = 2e-5
"""Typical tilt of the base with temperature, rad/K: that of a steel column 1 m high and 0.3 m wide, whose sides differ
by half a kelvin per kelvin of ambient change."""

ZERO = 1e-5
"""Typical drift of an encoder zero, rad/K. Gong (2000) reports a drift of up to 0.2 mrad over 20 K."""

SHORTEST = 0.02
"""Shortest link for which thermal growth is a candidate, m. A shorter link grows by less than 5 µm in 10 K."""


def arm_growth(
    name: str, mechanism: Mechanism, basis: Basis, unit: str, family: str, prior: float = math.inf
) -> Iterator[Effect]:
    """Yield the effect that stretches all lengths of a mechanism by an equal share; nothing without lengths."""
    terms = tuple(chain(*(terms for _, terms in _lengths(mechanism, basis))))
    if terms:
        yield Effect(name, terms, unit, family, prior)


def link_growth(
    name: str, mechanism: Mechanism, basis: Basis, unit: str, family: str, prior: float = math.inf
) -> Iterator[Effect]:
    """Yield an effect that stretches one length, for each link longer than SHORTEST and each prismatic joint.

    name: name of the effect, with {slot} for the frame at the end of the length.
    """
    for slot, terms in _lengths(mechanism, basis):
        if any(term.basis != basis for term in terms) or np.linalg.norm([term.weight for term in terms]) > SHORTEST:
            yield Effect(name.format(slot=slot), terms, unit, family, prior)


def _lengths(mechanism: Mechanism, basis: Basis) -> Iterator[tuple[str, tuple[Term, ...]]]:
    """Yield each frame (slot) with a length before the frame, and the terms that stretch the length: the offset from
    the previous frame, and the travel of a prismatic joint, whose screw or scale grows."""
    fixed = links(mechanism)
    travels = {
        slot: Term(slot, axis, Expression(f"{joint.name}*({basis})"), weight)
        for joint in mechanism.joints if joint.kind == "prismatic"
        for slot, axis, weight in joint.drive
    }  # fmt: skip
    for slot in mechanism.slots:
        offset = zip("xyz", fixed.get(slot, np.zeros(3)).tolist(), strict=True)
        terms = tuple(Term(slot, f"T{a}", basis, v) for a, v in offset if abs(v) > 1e-9)
        if terms := (*terms, travels[slot]) if slot in travels else terms:
            yield slot, terms


MOST_STEPS = 200
"""Number of evenly spaced rows of a long table at which a sudden shift (step) is a candidate; at most twice as many."""

EVENTS = 12
"""Number of trial moments at which settling may begin: enough for time constants above a twentieth of a session."""

SETTLED = 1e-4
"""Prior standard deviation of exponential settling, rad or relative length: 5 K of steel (Slocum 1992, ch. 2)."""


def _steps(states: States) -> list[int]:
    rows = np.sort(states["row"])
    if len(rows) < 10:
        return []
    stride = max(1, len(rows) // MOST_STEPS)
    return [int(r) for r in rows[4:-4:stride]]


def _moved_once(what: str, slot: str, axes: tuple[str, ...], family: str, states: States) -> Iterator[Candidate]:
    """Yield a sudden motion of one frame after each tested row, along all axes together and along each axis alone."""
    rows = _steps(states)
    name, basis = f"{what} after row {symbol()}", Expression(f"step(row - {symbol()})")
    effects = tuple(effect_at(f"{name}, {axis}", slot, axis, basis, family=family) for axis in axes)
    for row in rows:
        last = (Constant("last row before it", "row", row, 1.0, whole=True),)
        moved = inside(NonlinearParameters(name, effects, last), family, 3.0 + np.log(len(rows)))
        yield moved
        for template, effect in zip(effects, moved.effects, strict=True):
            inner = NonlinearParameters(template.name, (template,), last)
            yield Candidate(effect.name, (effect,), family, 3.0 + np.log(len(axes) * len(rows)), inner=inner)


def thermal_growth(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the growth of all lengths, of all travels, and of each link or travel, in proportion to a temperature."""
    for column in _measured_temperatures(states):
        unit = states.units[column]
        basis, name = Expression(relative(states, column, unit)), f"thermal growth of the arm ({column})"
        for effect in arm_growth(name, mechanism, basis, f"1/{unit}", "thermal_growth"):
            yield one(name, effect, 4.0)
            travels = tuple(term for term in effect.terms if term.basis != basis)
            if 1 < len(travels) < len(effect.terms):
                name = f"thermal growth of all travels ({column})"
                yield one(name, replace(effect, name=name, terms=travels), 4.0)
        name = f"thermal growth of the link before {{slot}} ({column})"
        for effect in link_growth(name, mechanism, basis, f"1/{unit}", "thermal_growth"):
            yield one(effect.name, effect, 5.0)


def thermal_zero(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the drift of each joint zero in proportion to a measured temperature."""
    for column in _measured_temperatures(states):
        basis = Expression(relative(states, column, states.units[column]))
        for j in mechanism.joints:
            name, unit = (
                f"thermal drift of the zero, {j.name} ({column})",
                axis_unit("R" if j.kind == "revolute" else "T", states.units[column]),
            )
            yield one(name, drive_effect(name, j, basis, unit, "thermal_zero"), 5.0)


def drift(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield a drift of the robot's base in proportion to the row number, or to a parabola of the row number."""
    name, row = "drift of the set-up", Expression("row")
    along = [effect_at(f"{name}, {a}", "base", a, row, axis_unit(a, "row"), "drift") for a in AXES]
    yield Candidate(name, tuple(along[:3]), "drift", 4.5)
    for effect in along:
        yield one(effect.name, effect, 4.5)
    share = share_of_rows(states)
    shapes = {"straight": Expression(share), "bent": Expression(f"4*{share}*(1 - {share})")}
    bent = [effect_at(f"{name}, {how} {a}", "base", a, s, "m", "drift") for how, s in shapes.items() for a in AXES[:3]]
    yield Candidate(f"{name}, bent", tuple(bent), "drift", 5.0)


def setup_step(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield, for each tested row of the table, candidate effects in which the base of the robot moves after the row."""
    yield from _moved_once("set-up moved", "base", AXES, "set_up_step", states)


def tool_slip(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield, for each tested row of the table, candidate effects in which the tool shifts suddenly after the row, m."""
    yield from _moved_once("tool slipped", "tool", AXES[:3], "tool_slip", states)


def zero_slip(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield, for each joint and tested row, a sudden shift of the joint zero after the row, as by a collision."""
    rows, name = _steps(states), f"zero slipped after row {symbol()}"
    for j in mechanism.joints:
        slip = drive_effect(f"{name}, {j.name}", j, Expression(f"step(row - {symbol()})"), family="zero_slip")
        for row in rows:
            last = (Constant("last row before it", "row", row, 1.0, whole=True),)
            price = 3.0 + math.log(len(mechanism.joints) * len(rows))
            yield inside(NonlinearParameters(slip.name, (slip,), last), "zero_slip", price)


def _clock(states: States) -> tuple[str, float, float, str]:
    """Return the column that orders the measurements (a time, or the row number), its first value, span and unit."""
    name = states.past.clock if states.past else "row"
    values = states.past.columns[name] if states.past else states[name]
    unit = "rows" if name == "row" else states.units[name]
    return name, float(np.min(values, initial=np.inf)), float(np.ptp(values)) or 1.0, unit


def _shortest(states: States, span: float) -> float:
    """Return the shortest time constant in a session of length `span`, that of two rows; a faster change is a step."""
    return 2.0 * span / max(len(states) - 1, 1)


def warm_up(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield warm-up effects exp(-t/τ) at time t of joint zeros, base and links, for several time constants τ."""
    clock, start, span, unit = _clock(states)
    since = clock if clock == "row" or start == 0 else f"({clock} - {start:.12g})"
    basis = Expression(f"exp(-{since}/{symbol()})")
    within, least = f"within {symbol()} {unit}", _shortest(states, span)
    zeros = [
        drive_effect(f"warm-up of the zero {within}, {j.name}", j, basis, family="warm_up") for j in mechanism.joints
    ]
    places = [effect_at(f"warm-up of the set-up {within}, {a}", "base", a, basis, family="warm_up") for a in AXES]
    links = link_growth(f"warm-up of the link before {{slot}} {within}", mechanism, basis, "m/m", "warm_up")
    for effect in (*zeros, *places, *links):
        for share in (0.05, 0.1, 0.2, 0.4):
            tau = Constant("time constant", unit, float(f"{share * span:.4g}"), share * span, least=least)
            yield inside(NonlinearParameters(effect.name, (effect,), (tau,)), "warm_up", 7.0)


def settling(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield settling 1 - exp(-t/τ), with t the time since an event, for each of EVENTS trial moments.

    Times that began long before the session, such as seconds since 1970, count from the first row.
    """
    clock, start, span, unit = _clock(states)
    if states.past is None:
        return
    origin = start if abs(start) > span else 0.0
    first = f"{origin:.12g} + " if origin else ""
    basis = Expression(f"1 - exp(-max({clock} - ({first}{symbol(0)}), 0)/{symbol(1)})")
    after = f"after {clock} {first}{symbol(0)} within {symbol(1)} {unit}"
    pause, least = span / (EVENTS + 1), _shortest(states, span)
    for k in range(1, EVENTS + 1):
        moment = Constant("moment of the event", unit, float(f"{start - origin + k * pause:.4g}"), pause)
        for share in (0.05, 0.15, 0.45):
            tau = Constant("time constant", unit, float(f"{share * span:.3g}"), share * span, number=1, least=least)
            for effect in _settling(mechanism, basis, after):
                inner = NonlinearParameters(effect.name, (effect,), (moment, tau))
                yield inside(inner, "settling", float(np.log(3 * EVENTS)) + 4.0)


def _settling(mechanism: Mechanism, basis: Expression, after: str) -> Iterator[Effect]:
    """Yield the exponential settling of each joint zero and of each link after an event."""
    for j in revolute(mechanism):
        yield drive_effect(f"settling of the zero {after}, {j.name}", j, basis, family="settling", prior=SETTLED)
    yield from link_growth(
        f"settling of the link before {{slot}} {after}", mechanism, basis, "m/m", "settling", SETTLED
    )


def _measured_temperatures(states: States) -> list[str]:
    return [c for c in temperatures(states.units) if not read_by(c)]


PLAY = 1e-4
"""Half the play of a drive, rad. A linear axis has half a play of 1e-5 m, that of a pitch radius of 0.1 m."""

WIDTHS = (0.02, 0.05, 0.1, 0.2)
"""Half-widths of stop operators, as shares of the travel of a joint or the span of a torque. A stop operator of smaller
width acts as play, one of larger width as a smooth curve."""

LAGS = 8
"""Number of trial time constants, in equal ratios from the time between rows to the length of the session."""


def _play(joint: Joint) -> float:
    return PLAY if joint.kind == "revolute" else 0.1 * PLAY


def _moving(mechanism: Mechanism, states: States) -> list[Joint]:
    return [j for j in mechanism.joints if states.past and f"last_move_{j.name}" in states.columns]


def _on_known_path(mechanism: Mechanism, states: States) -> list[Joint]:
    """Return the joints whose path is known, which have a stop operator among the columns."""
    operators = [operator for name in states.columns if (operator := constant_of(name))]
    stopped = {source for what, source, _ in operators if what == "stop"}
    return [j for j in mechanism.joints if states.past and j.name in stopped]


def play_last_move(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the play of each drive by the direction of its last move, ±1."""
    for j in _moving(mechanism, states):
        name = f"play by the last move, {j.name}"
        basis = Expression(f"last_move_{j.name}")
        yield one(name, drive_effect(name, j, basis, family="play_last_move", prior=_play(j)), 4.0)


def friction_windup(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the torsion of a joint held by friction, as the direction of approach ±1, alone and times the size of the
    torque.

    The direction of approach is the declared one, or else that of the last move.
    """
    side = {j.name: f"last_move_{j.name}" for j in _moving(mechanism, states)}
    side |= declared_approach([j.name for j in mechanism.joints], states.columns)
    for j in mechanism.joints:
        torque = f"torque_{j.name}"
        if j.name in side and loaded(states, torque):
            name, way = f"friction windup, {j.name}", side[j.name]
            load = f"abs({torque})/{float(np.max(np.abs(states[torque]))):.4g}"
            effects = tuple(
                drive_effect(f"{name}, {part}", j, Expression(basis), family="friction_windup", prior=_play(j))
                for part, basis in (("constant", way), ("with the load", f"{way}*{load}"))
            )
            yield Candidate(name, effects, "friction_windup", 4.5)


def hysteresis(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield hysteresis of each joint's angle or torque as stop operators: of several widths together and of each."""
    for j in _on_known_path(mechanism, states):
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
                alone = f"{name}, within {symbol()} {unit}"
                stop = drive_effect(
                    alone, j, Expression(f"stop_{column}_{symbol()}/{symbol()}"), family="hysteresis", prior=_play(j)
                )
                for c in constants:
                    inner = NonlinearParameters(alone, (stop,), (replace(c, number=0),))
                    yield inside(inner, "hysteresis", 5.0 + math.log(len(constants)))


def lagged_growth(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the growth of links, tilt of axes and drift of zeros that follow a temperature with a lag."""
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
    """Yield the effects that may follow a temperature with a lag, each effect with its name and penalty.

    The effects are the growth of the arm and of each link, the tilt of the base and of each axis, and the drift of each
    joint zero.
    """
    family, cost = "lagged_growth", 4.0 + float(np.log(LAGS))
    for effect in arm_growth(f"growth of the arm {where}", mechanism, basis, f"1/{kelvin}", family, EXPANSION):
        yield effect.name, (effect,), cost
    name = f"growth of the link before {{slot}} {where}"
    for effect in link_growth(name, mechanism, basis, f"1/{kelvin}", family, EXPANSION):
        yield effect.name, (effect,), cost + 1.0
    tilting = [("the base", "base", ("x", "y"))]
    tilting += [(j.name, f"{j.name}.moving", across(j)) for j in revolute(mechanism)]
    for what, slot, axes in tilting:
        name = f"tilt of {what} {where}"
        effects = tuple(
            effect_at(f"{name}, R{a}", slot, f"R{a}", basis, axis_unit("R", kelvin), family, TILT) for a in axes
        )
        yield name, effects, cost + 1.0
    for j in revolute(mechanism):
        name = f"drift of the zero of {j.name} {where}"
        yield name, (drive_effect(name, j, basis, axis_unit("R", kelvin), family, ZERO),), cost + 1.0
