"""Families of effects that are proportional to loads: bending, twist, tilt and sag, under known or unknown weights."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate, across, inside, loaded, one, revolute
from gpmodel.families.inner import Constant, NonlinearParameters, symbol
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Joint, KnownMasses, Mechanism, balls_of, unwrapped
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.sites import Site
from gpmodel.model.states import States


def base_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the tilt of the base about x and y in proportion to the moment on the base, rad/Nm."""
    if "moment_base_x" in states.columns:
        terms = tuple(Term("base", f"R{a}", Expression(f"moment_base_{a}")) for a in "xy")
        yield one("base compliance", Effect("base compliance", terms, "rad/Nm", "base_compliance"), 4.0)


def joint_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint in proportion to its torque, rad/Nm, or force, m/N."""
    for j in mechanism.joints:
        if loaded(states, f"torque_{j.name}"):
            unit = "rad/Nm" if j.kind == "revolute" else "m/N"
            effect = drive_effect(
                f"joint compliance, {j.name}", j, Expression(f"torque_{j.name}"), unit, "joint_compliance"
            )
            yield one(effect.name, effect, 4.0)


def payload_deflection(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint in proportion to the torque of the payload alone, rad/Nm or m/N."""
    for j in mechanism.joints:
        column = f"payload_torque_{j.name}"
        if loaded(states, column):
            name = f"deflection under the payload, {j.name}"
            unit = "rad/Nm" if j.kind == "revolute" else "m/N"
            yield one(name, drive_effect(name, j, Expression(column), unit, "payload_deflection"), 4.5)


def joint_bending(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the tilt of each bearing or carriage in proportion to the moments at its joint, rad/Nm.

    The bearing of a revolute joint tilts across the joint axis. The carriage of a linear joint tilts across its
    guideway and rolls about it.
    """
    for j in mechanism.joints:
        axes = [a for a in (across(j) if j.kind == "revolute" else "xyz") if loaded(states, f"moment_{j.name}_{a}")]
        terms = tuple(Term(f"{j.name}.moving", f"R{a}", Expression(f"moment_{j.name}_{a}")) for a in axes)
        if terms:
            effect = Effect(f"joint bending, {j.name}", terms, "rad/Nm", "joint_bending")
            yield one(effect.name, effect, 5.0)
        for term in terms if len(terms) > 1 else ():
            name = f"joint bending, {j.name} about {term.axis[1]} only"
            yield one(name, Effect(name, (term,), "rad/Nm", "joint_bending"), 5.5)


def backlash_load(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the play (backlash) of each drive, on the side to which the load pushes: the sign of the torque."""
    for j in mechanism.joints:
        if loaded(states, f"torque_{j.name}"):
            basis = Expression(f"sign(torque_{j.name})")
            effect = drive_effect(f"backlash by load, {j.name}", j, basis, family="backlash_load")
            yield one(effect.name, effect, 4.5)


def balancing_spring(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the joint error by the spring that balances the second revolute joint, sin q of the joint angle q."""
    for j in revolute(mechanism)[1:2]:
        effect = drive_effect(f"balancing spring, {j.name}", j, Expression(f"sin({j.name})"), family="balancing_spring")
        yield one(effect.name, effect, 4.5)


def hardening(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the joint error by a stiffness that grows with the load: the cube of torque over largest torque."""
    for j, load in _relative_loads(mechanism, states):
        yield one(f"hardening stiffness, {j.name}", _hardening(j, "", f"({load})**3"), 5.0)


def compliance_with_hardening(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint as torque and cube of torque, both over the largest torque."""
    for j, load in _relative_loads(mechanism, states):
        effects = _hardening(j, ", linear", load), _hardening(j, ", cubic", f"({load})**3")
        yield Candidate(f"hardening stiffness, {j.name}", effects, "hardening_stiffness", 5.0 + SECOND)


def _relative_loads(mechanism: Mechanism, states: States) -> Iterator[tuple[Joint, str]]:
    """Yield each loaded joint with its torque over the largest torque, as a formula."""
    for j in mechanism.joints:
        torque = f"torque_{j.name}"
        if loaded(states, torque):
            yield j, f"{torque}/{float(np.max(np.abs(states[torque]))):.4g}"


def _hardening(joint: Joint, part: str, formula: str) -> Effect:
    name = f"hardening stiffness, {joint.name}{part}"
    return drive_effect(name, joint, Expression(formula), family="hardening_stiffness")


def preload(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the shift of a ball joint along its leg under the pull beyond a part of its preload, m/N."""
    for ball in balls_of(mechanism):
        if ball.axial and loaded(states, ball.axial):
            pull = states[ball.axial]
            name = f"ball that yields beyond {symbol()} N{ball.suffix}"
            basis = Expression(f"max({ball.axial} - {symbol()}, 0)")
            effect = Site(ball.along[1]).effect(name, basis, "m/N", "preload")
            for share in (0.25, 0.5, 0.75):
                limit = Constant("load", "N", float(f"{np.quantile(pull, share):.4g}"), float(np.ptp(pull)) / 4)
                yield inside(NonlinearParameters(name, (effect,), (limit,)), "preload", 6.0)


def support_sag(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the shift of the robot's support along gravity, as one effect and along each axis alone.

    Each ball joint of a machine shifts along its leg in proportion to the load at the ball, m/N.
    """
    for ball in balls_of(mechanism):
        if ball.axial and loaded(states, ball.axial):
            name = f"sag of the support{ball.suffix}"
            yield one(name, Site(ball.along[1]).effect(name, Expression(ball.axial), "m/N", "support_sag"), 4.5)
    terms = tuple(Term("base", f"T{a}", Expression(f"gravity_{a}")) for a in "xyz" if f"gravity_{a}" in states.columns)
    if terms:
        unit = f"m/({states.units[str(terms[0].basis)]})"
        yield one("sag of the support", Effect("sag of the support", terms, unit, "support_sag"), 4.0)
        for term in terms if len(terms) > 1 else ():
            name = f"sag of the support along {term.axis[1]}"
            yield one(name, Effect(name, (term,), unit, "support_sag"), 4.5)


DEFLECTION = 7e-4
"""Typical deflection of a joint under gravity, rad: a shoulder of 4e6 N·m/rad under 3 kN·m, a forearm of 2e5 under 140
N·m (Dumas 2011)."""


SECOND = 5.0
"""Additional penalty of wrong masses, and of hardening, over that of a compliance, nats: the least gain of a finding,
because either is a second finding."""


def unknown_masses(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint under unit first moments (mass times lever) of every link beyond the joint."""
    for j in revolute(mechanism):
        prefix = f"torque_{j.name}_of_"
        moments = [n for n in _unit_loads(states) if n.startswith(prefix) and n.endswith(("_x", "_y", "_z"))]
        if moments:
            name = f"compliance with unknown masses, {j.name}"
            prior = _share(states, moments)
            said = ((f"{name}, moment of {m.removeprefix(prefix)}", Expression(m)) for m in moments)
            effects = (drive_effect(n, j, basis, "rad·kg·m/Nm", "unknown_masses", prior) for n, basis in said)
            yield Candidate(name, tuple(effects), "unknown_masses", 5.0)


def base_unknown_masses(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the tilt of the base about x and y under unit first moments (mass times lever) of every link.

    Each first moment has one coefficient for both axes, since the base is assumed equally stiff about x and y.
    """
    loads, prefix = _unit_loads(states), "moment_base_x_of_"
    moments = [n for n in loads if n.startswith(prefix) and n.replace("moment_base_x", "moment_base_y") in loads]
    if moments:
        name = "base compliance with unknown masses"
        effects = tuple(
            Effect(
                f"{name}, {m.removeprefix('moment_base_x_of_')}",
                tuple(
                    Term("base", f"R{a}", Expression(m.replace("moment_base_x", f"moment_base_{a}"))) for a in "xy"
                ),
                "rad·kg·m/Nm", "base_unknown_masses", _share(states, moments),
            )
            for m in moments
        )  # fmt: skip
        yield Candidate(name, effects, "base_unknown_masses", 5.0)


def wrong_masses(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint under the weight of each link beyond it, with one coefficient per link."""
    for j in revolute(mechanism):
        prefix = f"torque_{j.name}_of_"
        parts = [n for n in _unit_loads(states) if n.startswith(prefix) and not n.endswith(("_x", "_y", "_z"))]
        if len(parts) > 1:
            name = f"compliance with wrong masses, {j.name}"
            prior = DEFLECTION / max(float(np.max(np.abs(sum(_unit_loads(states)[n] for n in parts)))), 1e-9)
            effects = tuple(
                drive_effect(
                    f"{name}, weight of {n.removeprefix(prefix)}", j, Expression(n), "rad/Nm", "wrong_masses", prior
                )
                for n in parts
            )
            yield Candidate(name, effects, "wrong_masses", 5.0 + SECOND)


NEGLIGIBLE = 1e-9
"""Lever arm of a mass, m, below which the arm is a rounding error."""


def _weighted(load: str, parts: Mapping[str, float]) -> str:
    factors = (
        "" if weight == 1.0 else f"{weight:.5g}*" if weight > 0.0 else f"({weight:.5g})*" for weight in parts.values()
    )
    return " + ".join(f"{factor}{load}_of_{part}" for factor, part in zip(factors, parts, strict=True))


def _mass(mechanism: Mechanism, com: Array | None) -> Mapping[str, float]:
    """Return the unit loads, with weights, of a mass of 1 kg at the tool: first moments of mass, one per link.

    Each first moment is the mass times the lever to the next link. com: centre of the mass in the measured frame, m;
    None for the centre of the payload.
    """
    bare = unwrapped(mechanism)
    if not isinstance(bare, KnownMasses) or not all(j.kind == "revolute" for j in bare.joints):
        return {}
    fixed = bare.transforms(np.zeros((1, len(bare.joints))))[:, 0]
    moving = [k for k, slot in enumerate(bare.slots) if slot.endswith(".moving")]
    links = [bare.slots[k].removesuffix(".moving") for k in moving]
    levers = [fixed[k + 1][:3, 3] for k in moving[:-1]]
    levers.append(fixed[-1][:3, :3] @ np.asarray(bare.payload_com if com is None else com) + fixed[-1][:3, 3])
    sides = (
        (f"{n}_{a}", float(v))
        for n, lever in zip(links, levers, strict=True)
        for a, v in zip("xyz", lever, strict=True)
    )
    return {side: value for side, value in sides if abs(value) > NEGLIGIBLE}


MASS = "mass at the tool"
"""Name of an unknown additional mass at the tool, in a message."""


def mass_at_tool(
    mechanism: Mechanism, states: States, effects: Sequence[Effect], theta: Array, com: Array | None
) -> Effect | None:
    """Return the displacement, m and rad per kg, that additional mass at the tool causes by a model's compliances.

    effects, theta: effects of the model and their values. com: centre of the mass in the measured frame, m; None for
    that of the payload. A model without a compliance or known masses gives None.
    """
    loads, mass, terms = _unit_loads(states), _mass(mechanism, com), []
    for effect, value in zip(effects, theta.tolist(), strict=True):
        for t in effect.terms if value else ():
            own = {part: lever for part, lever in mass.items() if f"{t.basis}_of_{part}" in loads}
            if own:
                terms.append(Term(t.slot, t.axis, Expression(_weighted(str(t.basis), own)), t.weight * value))
    return Effect(MASS, tuple(terms), "kg") if terms else None


def moments_at_tool(
    mechanism: Mechanism, states: States, effects: Sequence[Effect], theta: Array
) -> tuple[Effect, ...]:
    """Return the displacements, m and rad per kg m, that first moments of mass along x, y, z of the tool cause.

    Arguments are described in `mass_at_tool`. Without a compliance or known masses the result is empty.
    """
    made = [mass_at_tool(mechanism, states, effects, theta, point) for point in (np.zeros(3), *np.eye(3))]
    start, *ends = [effect.terms if effect else () for effect in made]
    back = tuple(replace(term, weight=-term.weight) for term in start)
    named = zip("xyz", ends, strict=True)
    return tuple(Effect(f"{MASS}, first moment along {a}", (*end, *back), "kg m") for a, end in named if end)


def _unit_loads(states: States) -> Mapping[str, Array]:
    return states.weights.columns if states.weights else {}


def _share(states: States, moments: list[str]) -> float:
    """Return the prior of each first moment with which all first moments together give the typical deflection."""
    squares = sum(float(np.mean(_unit_loads(states)[m] ** 2)) for m in moments)
    return DEFLECTION / float(np.sqrt(squares))
