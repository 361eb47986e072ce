"""The catalogue: what a finding would be physically. One row a family; adding a known effect is one line.

The entry bar for a family: a cited mechanism, or a recorded discovery.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gpmodel.basis import Expression
from gpmodel.effect import Effect, Term, axis_unit, drive_effect, effect_at
from gpmodel.errors import InputError
from gpmodel.mechanism import AXES, Joint, Mechanism
from gpmodel.states import States


@dataclass(frozen=True)
class Candidate:
    """One thing the model may be missing: effects that come together, each with its own unknown.

    cost: nats of description beyond the data: the log of how many alternatives it was chosen from.
    """

    name: str
    effects: tuple[Effect, ...]
    family: str
    cost: float
    found_by: str = "catalogue"


Builder = Callable[[Mechanism, States], Iterator[Candidate]]


@dataclass(frozen=True)
class Family:
    """A named physical effect: what it is, who described it, and its instances on a mechanism."""

    name: str
    explanation: str
    source: str
    build: Builder


def _one(name: str, effect: Effect, cost: float) -> Candidate:
    return Candidate(name, (effect,), effect.family, cost)


def _pair(name: str, joint: Joint, argument: str, family: str, cost: float) -> Candidate:
    effects = tuple(
        drive_effect(f"{name}, {f}", joint, Expression(f"{f}({argument})"), family=family) for f in ("sin", "cos")
    )
    return Candidate(name, effects, family, cost)


def _revolute(mechanism: Mechanism) -> list[Joint]:
    return [j for j in mechanism.joints if j.kind == "revolute"]


def _across(joint: Joint) -> tuple[str, str]:
    """The two axes at right angles to a joint's own."""
    own = joint.drive[0][1][1]
    first, second = (a for a in "xyz" if a != own)
    return first, second


def _base_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    if "moment_base_x" in states.columns:
        terms = tuple(Term("base", f"R{a}", Expression(f"moment_base_{a}")) for a in "xy")
        yield _one("base compliance", Effect("base compliance", terms, "rad/Nm", "base_compliance"), 4.0)


NO_LOAD = 1e-6


def _loaded(states: States, load: str) -> bool:
    """Whether a load is there and more than rounding: an axis through its centre of mass carries none."""
    return load in states.columns and float(np.max(np.abs(states[load]), initial=0.0)) > NO_LOAD


def _joint_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        if _loaded(states, f"torque_{j.name}"):
            unit = "rad/Nm" if j.kind == "revolute" else "m/N"
            effect = drive_effect(
                f"joint compliance, {j.name}", j, Expression(f"torque_{j.name}"), unit, "joint_compliance"
            )
            yield _one(effect.name, effect, 4.0)


def _payload_deflection(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        column = f"payload_torque_{j.name}"
        if _loaded(states, column):
            name = f"deflection under the payload, {j.name}"
            unit = "rad/Nm" if j.kind == "revolute" else "m/N"
            yield _one(name, drive_effect(name, j, Expression(column), unit, "payload_deflection"), 4.5)


def _joint_bending(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in _revolute(mechanism):
        axes = _across(j)
        if f"moment_{j.name}_x" in states.columns:
            terms = tuple(Term(f"{j.name}.moving", f"R{a}", Expression(f"moment_{j.name}_{a}")) for a in axes)
            effect = Effect(f"joint bending, {j.name}", terms, "rad/Nm", "joint_bending")
            yield _one(effect.name, effect, 5.0)
            for term in terms:
                name = f"{effect.name} about {term.axis[1]} only"
                yield _one(name, Effect(name, (term,), "rad/Nm", "joint_bending"), 5.5)


def _eccentricity(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in _revolute(mechanism):
        yield _pair(f"eccentricity, 1 per turn, {j.name}", j, j.name, "eccentricity", 4.0)


def _gear_harmonic(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in _revolute(mechanism):
        yield _pair(f"gear error, 2 per turn, {j.name}", j, f"2*{j.name}", "gear_harmonic", 4.5)


def _transmission_ripple(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    highest = 12 if len(states) < 300 else 400
    for j in _revolute(mechanism):
        for n in range(3, highest + 1):
            cost = 4.0 + np.log(highest)
            yield _pair(f"transmission ripple, {n} per turn, {j.name}", j, f"{n}*{j.name}", "transmission_ripple", cost)


def _backlash_load(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        if _loaded(states, f"torque_{j.name}"):
            basis = Expression(f"sign(torque_{j.name})")
            effect = drive_effect(f"backlash by load, {j.name}", j, basis, family="backlash_load")
            yield _one(effect.name, effect, 4.5)


def _backlash_approach(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for column in states.columns:
        if column.startswith("approach"):
            for i, j in enumerate(mechanism.joints, 1):
                own = column in (f"approach_{j.name}", f"approach_J{i}")
                effect = drive_effect(
                    f"backlash by approach, {j.name} ({column})", j, Expression(column), family="backlash_approach"
                )
                yield _one(effect.name, effect, 4.0 if own else 6.0)


def _gear_ratio(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        effect = drive_effect(f"gear ratio, {j.name}", j, Expression(j.name), "1", "gear_ratio")
        yield _one(effect.name, effect, 4.0)


def _wrist_coupling(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    joints = _revolute(mechanism)
    for i, source in enumerate(joints):
        for target in joints[i + 1 :]:
            effect = drive_effect(
                f"coupling, {source.name} to {target.name}", target, Expression(source.name), "1", "wrist_coupling"
            )
            yield _one(effect.name, effect, 4.0 if i >= len(joints) - 3 else 5.5)


def _parallel_bar(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        for slot, _, _ in j.drive[1:]:
            other = next(o for o in mechanism.joints if slot == f"{o.name}.moving")
            yield _pair(f"parallel-bar closure, {j.name}", other, j.name, "parallel_bar_closure", 4.5)


CURVE_SPREAD = 5e-4
CURVE_CORNER = 15.0


def _joint_curve(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    highest = 12 if len(states) < 150 else 40 if len(states) < 600 else 60
    k = np.arange(1, highest + 1)
    shape = 1.0 / (1.0 + (k / CURVE_CORNER) ** 1.5)
    for spread in (CURVE_SPREAD, CURVE_SPREAD / 4):
        deviation = spread * shape / np.sqrt(np.sum(shape**2))
        for j in _revolute(mechanism):
            name = f"error curve of the angle, {j.name}"
            effects = tuple(
                drive_effect(
                    f"{name}, {f} {n}", j, Expression(f"{f}({n}*{j.name})"), family="joint_curve", prior=float(s)
                )
                for n, s in zip(k, deviation, strict=True)
                for f in ("sin", "cos")
            )
            yield Candidate(name, effects, "joint_curve", 6.0)


def _balancing_spring(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in _revolute(mechanism)[1:2]:
        effect = drive_effect(f"balancing spring, {j.name}", j, Expression(f"sin({j.name})"), family="balancing_spring")
        yield _one(effect.name, effect, 4.5)


def _hardening(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        torque = f"torque_{j.name}"
        if _loaded(states, torque):
            scale = float(np.max(np.abs(states[torque])))
            basis = Expression(f"({torque}/{scale:.4g})**3")
            yield _one(f"hardening stiffness, {j.name}",
                       drive_effect(f"hardening stiffness, {j.name}", j, basis, family="hardening_stiffness"), 5.0)  # fmt: skip


def _temperatures(states: States) -> list[str]:
    return [c for c in states.columns if states.units[c] in ("degC", "K", "kelvin", "celsius", "degF", "°C")]


def _thermal_growth(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    rest = mechanism.transforms(np.zeros((1, len(mechanism.joints))))[:, 0, :3, :]
    for column in _temperatures(states):
        terms = []
        for slot, frame in zip(mechanism.slots[1:], rest[1:], strict=True):
            lengths = frame[:, :3].T @ frame[:, 3]
            terms += [
                Term(slot, f"T{a}", Expression(column), float(v))
                for a, v in zip("xyz", lengths, strict=True)
                if abs(v) > 1e-9
            ]
        name = f"thermal growth of the arm ({column})"
        yield _one(name, Effect(name, tuple(terms), f"1/{states.units[column]}", "thermal_growth"), 4.0)
        for slot, frame in zip(mechanism.slots[1:], rest[1:], strict=True):
            lengths = frame[:, :3].T @ frame[:, 3]
            if np.linalg.norm(lengths) > 0.02:
                along = tuple(
                    Term(slot, f"T{a}", Expression(column), float(v))
                    for a, v in zip("xyz", lengths, strict=True)
                    if abs(v) > 1e-9
                )
                name = f"thermal growth of the link before {slot} ({column})"
                yield _one(name, Effect(name, along, f"1/{states.units[column]}", "thermal_growth"), 5.0)


def _thermal_zero(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for column in _temperatures(states):
        for j in mechanism.joints:
            effect = drive_effect(
                f"thermal drift of the zero, {j.name} ({column})", j, Expression(column), family="thermal_zero"
            )
            yield _one(effect.name, effect, 5.0)


def _drift(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    name, row = "drift of the set-up", Expression("row")
    along = [effect_at(f"{name}, {a}", "base", a, row, f"{axis_unit(a)}/row", "drift") for a in AXES]
    yield Candidate(name, tuple(along[:3]), "drift", 4.5)
    for effect in along:
        yield _one(effect.name, effect, 4.5)


MOST_STEPS = 200


def _steps(states: States) -> list[int]:
    rows = np.sort(states["row"])
    if len(rows) < 10:
        return []
    stride = max(1, len(rows) // MOST_STEPS)
    return [int(r) for r in rows[4:-4:stride]]


def _setup_step(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    yield from _moved_once("set-up moved", "base", AXES, "set_up_step", states)


def _tool_slip(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    yield from _moved_once("tool slipped", "tool", AXES[:3], "tool_slip", states)


def _moved_once(what: str, slot: str, axes: tuple[str, ...], family: str, states: States) -> Iterator[Candidate]:
    """A step after a row, along each axis and along all of them together."""
    rows = _steps(states)
    for row in rows:
        name, basis = f"{what} after row {row}", Expression(f"step(row - {row}.5)")
        effects = tuple(effect_at(f"{name}, {axis}", slot, axis, basis, family=family) for axis in axes)
        yield Candidate(name, effects, family, 3.0 + np.log(len(rows)))
        for effect in effects:
            yield _one(effect.name, effect, 3.0 + np.log(len(axes) * len(rows)))


def _warm_up(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    span = float(np.ptp(states["row"])) or 1.0
    for share in (0.05, 0.1, 0.2, 0.4):
        basis = Expression(f"exp(-row/{share * span:.4g})")
        for j in mechanism.joints:
            name = f"warm-up of the zero, {j.name}"
            yield _one(name, drive_effect(name, j, basis, family="warm_up"), 7.0)
        for axis in AXES:
            name = f"warm-up of the set-up, {axis}"
            yield _one(name, effect_at(name, "base", axis, basis, family="warm_up"), 7.0)


def _axis_wobble(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in _revolute(mechanism):
        for a in _across(j):
            name = f"axis wobble, {j.name} R{a}"
            effects = tuple(
                effect_at(
                    f"{name}, {f}", f"{j.name}.moving", f"R{a}", Expression(f"{f}({j.name})"), family="axis_wobble"
                )
                for f in ("sin", "cos")
            )
            yield Candidate(name, effects, "axis_wobble", 5.0)


def _run_out(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in _revolute(mechanism):
        for a in "xyz":
            for f in ("sin", "cos"):
                name = f"axis run-out, {j.name} T{a}, {f}"
                basis = Expression(f"{f}({j.name})")
                yield _one(name, effect_at(name, f"{j.name}.moving", f"T{a}", basis, family="axis_run_out"), 5.5)


# ruff: noqa: E501
def _ball_lobes(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        if not j.measured and j.kind == "revolute":
            for lobes in (2, 3):
                for a in "xyz":
                    name = f"out-of-round ball, {lobes} lobes over {j.name}, lift along {a}"
                    effects = tuple(
                        effect_at(
                            f"{name}, {f}", "base", f"T{a}", Expression(f"{f}({lobes}*{j.name})"), family="ball_lobes"
                        )
                        for f in ("sin", "cos")
                    )
                    yield Candidate(name, effects, "ball_lobes", 4.5 if a == "z" else 5.0)


def _support_sag(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    terms = tuple(Term("base", f"T{a}", Expression(f"gravity_{a}")) for a in "xyz" if f"gravity_{a}" in states.columns)
    if terms:
        unit = f"m/({states.units[str(terms[0].basis)]})"
        yield _one("sag of the support", Effect("sag of the support", terms, unit, "support_sag"), 4.0)
        for term in terms if len(terms) > 1 else ():
            name = f"sag of the support along {term.axis[1]}"
            yield _one(name, Effect(name, (term,), unit, "support_sag"), 4.5)


FAMILIES: tuple[Family, ...] = (
    Family("base_compliance", "the foundation tilts under the gravity moment of the arm", "Robertson et al. 2002", _base_compliance),
    Family("joint_compliance", "gearbox and structure twist about the joint under its gravity torque", "Robertson et al. 2002 (as joint bending); Dumas 2011", _joint_compliance),
    Family("payload_deflection", "the controller allows for the arm's own weight, not for what it carries", "Dumas 2011", _payload_deflection),
    Family("joint_bending", "the bearing tilts across the joint's axis under the gravity moment", "Klimchik 2014", _joint_bending),
    Family("eccentricity", "encoder disc or gear off its centre: one cycle a turn", "Slocum 1992, ch. 6", _eccentricity),
    Family("gear_harmonic", "two cycles a turn: oval gear or flexspline", "Tuttle 1992", _gear_harmonic),
    Family("transmission_ripple", "a tooth- or wave-generator-passing error of the transmission", "Tuttle 1992", _transmission_ripple),
    Family("joint_curve", "encoder and transmission together: a smooth error curve of the joint's own angle", "recorded discovery: the measured UR10 and UR5", _joint_curve),
    Family("backlash_load", "the play of the gear falls to the side its gravity torque points to", "Gong 2000", _backlash_load),
    Family("backlash_approach", "the play of the gear depends on the direction of approach", "ISO 230-2", _backlash_approach),
    Family("gear_ratio", "the transmission ratio differs from the nominal one", "Mooring 1991", _gear_ratio),
    Family("wrist_coupling", "one wrist axis drags another through its gears", "Mooring 1991", _wrist_coupling),
    Family("parallel_bar_closure", "the parallel bar is no exact parallelogram", "Schröer 1997", _parallel_bar),
    Family("balancing_spring", "the balancing spring leaves a torque over the angle of its axis", "Schröer 1997", _balancing_spring),
    Family("hardening_stiffness", "stiffness grows with load: strain-wave gear", "Harmonic Drive catalogue, torsional stiffness K1-K3", _hardening),
    Family("thermal_growth", "links grow with temperature", "Slocum 1992, ch. 2", _thermal_growth),
    Family("thermal_zero", "a joint's zero drifts with temperature", "Gong 2000", _thermal_zero),
    Family("drift", "instrument or base creeps during the session", "ISO 230-3", _drift),
    Family("set_up_step", "the instrument or the base was moved between two rows", "ISO 10360-10", _setup_step),
    Family("tool_slip", "the reflector or the tool shifted between two rows", "ISO 10360-10", _tool_slip),
    Family("warm_up", "an exponential approach to the warm state", "ISO 230-3", _warm_up),
    Family("axis_wobble", "the axis tilts as it turns", "ISO 230-7", _axis_wobble),
    Family("axis_run_out", "the axis shifts as it turns", "ISO 230-7", _run_out),
    Family("ball_lobes", "an out-of-round ball lifts in its socket as it turns", "ISO 12181-1; Robertson 2003, 3.3.2", _ball_lobes),
    Family("support_sag", "the part sinks into its support along the gravity direction of the pose", "Robertson 2003, 4.2 (stiffness of the contact)", _support_sag),
)  # fmt: skip


def candidates(mechanism: Mechanism, states: States) -> tuple[Candidate, ...]:
    """Every instance of every family that these poses and columns allow."""
    return tuple(c for family in FAMILIES for c in family.build(mechanism, states))


def names() -> tuple[str, ...]:
    """The families' names."""
    return tuple(f.name for f in FAMILIES)


def family(name: str) -> Family | None:
    """The family of that name, or None."""
    return next((f for f in FAMILIES if f.name == name), None)


def build(name: str, mechanism: Mechanism, states: States) -> tuple[Effect, ...]:
    """Effects of `family`, `family JOINT` or a candidate's full name, as written on a command line.

    Raises InputError for an unknown name, or one with no instance on this mechanism and table.
    """
    pool = candidates(mechanism, states)
    exact = [c for c in pool if c.name == name]
    if exact:
        return exact[0].effects
    first, *words = name.split() or [""]
    of_family = [c for c in pool if c.family == first]
    if family(first) is None:
        raise InputError(f"effect '{name}' is unknown; available: {', '.join(names())}")
    wanted = [c for c in of_family if all(_mentions(c.name, w, mechanism) for w in words)]
    if not wanted:
        instances = "; ".join(c.name for c in of_family[:12]) or "none on this mechanism and table"
        raise InputError(f"effect '{name}' has no instance here; of {first} there are: {instances}")
    return wanted[0].effects


def _mentions(text: str, word: str, mechanism: Mechanism) -> bool:
    aliases = {f"J{i}": j.name for i, j in enumerate(mechanism.joints, 1)}
    tokens = text.replace(",", " ").replace("(", " ").replace(")", " ").split()
    return word in tokens or aliases.get(word) in tokens
