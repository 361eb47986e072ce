"""Families of effects that follow the joint coordinates: gears, encoders, bearings, couplings and linear axes.

Errors of linear axes have the names of ISO 230-1: E, then the direction of the error, then the moving axis. Example of
ISO 230-1 names: EXZ is the straightness in X of an axis along Z, EAZ its tilt about X, ECZ its roll about itself, EZZ
its positioning, in the frame of the joint.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import chain, pairwise, product

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate, across, one, pair, revolute
from gpmodel.families.frequency_grid import FrequencyGrid, frequency_grid
from gpmodel.families.inner import symbol
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES, Joint, Mechanism, balls_of
from gpmodel.model.effect import Effect, axis_unit, drive_effect, effect_at
from gpmodel.model.memory import APPROACH, declared_approach
from gpmodel.model.sites import Site
from gpmodel.model.states import States

LENGTH, ANGLE = 5e-5, 5e-5
"""Prior standard deviations of guideway errors over the travel, m and rad: between a machine tool (10 µm) and a
robot track (0.2 mm)."""

WAVES = 4
"""Number of half waves of an error over the travel of a guideway, which bends and sags over a quarter of it or more."""

LEADS = (1, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40)
"""Nominal leads of ball screws, mm (ISO 3408-2)."""

SHORTEST = 2e-3
"""Shortest period of a cyclic error, m. No robot has a finer screw, and robots repeat poses to 0.2 mm at best."""

TURN = {"x": "A", "y": "B", "z": "C"}


def prismatic(mechanism: Mechanism) -> list[Joint]:
    """Return the prismatic (linear) joints of a mechanism."""
    return [j for j in mechanism.joints if j.kind == "prismatic"]


def _travel(joint: Joint, states: States) -> tuple[float, float]:
    values = states[joint.name]
    return float(np.min(values)), float(np.ptp(values))


def linear_curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the six error motions of each linear axis as smooth curves of its position."""
    for j in prismatic(mechanism):
        start, travel = _travel(j, states)
        if travel > 0:
            for axis in ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz"):
                name = f"{_called(j, axis)}, {j.name}"
                yield Candidate(name, tuple(_curve(name, j, axis, start, travel)), "linear_axis", 4.5)


def _called(joint: Joint, axis: str) -> str:
    own, way = joint.drive[0][1][1], axis[1]
    letter = way.upper() if axis[0] == "T" else TURN[way]
    kind = "straightness" if axis[0] == "T" else "pitch or yaw"
    if way == own:
        kind = "positioning" if axis[0] == "T" else "roll"
    return f"{kind} E{letter}{own.upper()}"


def _curve(name: str, joint: Joint, axis: str, start: float, travel: float) -> Iterator[Effect]:
    """Yield sin(π k u) and cos(π k u), k = 1.., with u from 0 to 1 over the travel and priors falling as 1/k.

    The period of the first wave is twice the travel. A smooth curve with different end values then needs few waves,
    whereas the coefficients of cosines alone fall off as 1/k² (Huybrechs 2010).
    """
    orders = np.arange(1, WAVES + 1)
    share = (1.0 / orders) / np.linalg.norm(1.0 / orders) / np.sqrt(2.0)
    for (k, part), wave in product(zip(orders, share, strict=True), ("sin", "cos")):
        basis = Expression(f"{wave}({np.pi * k / travel:.6g}*({joint.name} - {start:.6g}))")
        prior = float(part) * (LENGTH if axis[0] == "T" else ANGLE)
        said = f"{name}, half wave {k}, {wave}"
        if axis == joint.drive[0][1]:
            yield drive_effect(said, joint, basis, family="linear_axis", prior=prior)
        else:
            yield effect_at(said, joint.drive[0][0], axis, basis, family="linear_axis", prior=prior)


def cyclic(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield periodic positioning errors, with each screw lead of ISO 3408-2 up to a third of the travel as period."""
    for j in prismatic(mechanism):
        start, travel = _travel(j, states)
        for lead in LEADS:
            if 3e-3 * lead <= travel:
                name = f"cyclic error, every {lead} mm, {j.name}"
                argument = f"{2e3 * np.pi / lead:.8g}*({j.name} - {start:.6g})"
                yield pair(name, j, argument, "cyclic_error", 4.0 + float(np.log(len(LEADS))), LENGTH)


def cyclic_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """Yield periodic positioning errors of screws, racks and scales, of any period up to a third of the travel."""
    for j in prismatic(mechanism):
        start, travel = _travel(j, states)
        argument = f"{2e3 * np.pi:.8g}/{symbol()}*({j.name} - {start:.6g})"
        wave = pair(f"cyclic error, every {symbol()} mm, {j.name}", j, argument, "cyclic_error", 4.0, LENGTH)
        span = (6 * np.pi / travel if travel > 0 else 0.0, 2 * np.pi / SHORTEST)
        found = frequency_grid(wave, j, (start, travel), span, lambda rate: 2e3 * np.pi / rate)
        if found is not None:
            yield replace(found, called=("period", "mm"))


CURVE_SPREAD = 5e-4
CURVE_CORNER = 15.0
"""Prior standard deviation of a joint's angular error over its angle, rad, and the number of the harmonic from which
the prior falls off."""

SMOOTH = (10, 3.0)
"""Number of harmonics of a smooth error over an angle, and the number of the harmonic from which the prior falls off.
Eccentric and bent gears cause the first few harmonics of an angle."""

WOBBLE, RUN_OUT = 5e-5, 2e-5
"""Prior tilt and radial run-out of a robot's crossed roller bearing, rad (10 arcsec) and m (ISO 230-7; Slocum 1992,
ch. 8)."""

LOBES = (2, 3, 4)
"""Numbers of lobes of a ball's roundness error: three, as from centreless grinding, and two and four."""

Curve = tuple[Effect, ...]


def eccentricity(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the error of an eccentric scale or gear: a sin q + b cos q on each revolute joint, rad."""
    for j in revolute(mechanism):
        yield pair(f"eccentricity, 1 per turn, {j.name}", j, j.name, "eccentricity", 4.0)


def gear_harmonic(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield a gear error of two periods a turn: a sin 2q + b cos 2q on each revolute joint, rad."""
    for j in revolute(mechanism):
        yield pair(f"gear error, 2 per turn, {j.name}", j, f"2*{j.name}", "gear_harmonic", 4.5)


@cache
def wave(function: str, number: int, angle: str) -> Expression:
    """Return one harmonic of an angle as an expression, such as sin(3*J2)."""
    return Expression(f"{function}({angle})" if number == 1 else f"{function}({number}*{angle})")


def spectrum(count: int, corner: float) -> Array:
    """Return the relative prior standard deviation of each harmonic k: 1 / (1 + (k / corner)^1.5), scaled to a sum of
    squares of one."""
    shape = 1.0 / (1.0 + (np.arange(1, count + 1) / corner) ** 1.5)
    return np.asarray(shape / np.sqrt(np.sum(shape**2)))


def harmonics(name: str, site: Site, angle: str, family: str, deviations: Array) -> Curve:
    """Return effects sin(k angle) and cos(k angle) at a site. deviations: prior σ for k = 1, 2, ..., rad or m."""
    unit = axis_unit(site.terms[0][1])
    return tuple(
        site.effect(f"{name}, {f} {k}", wave(f, k, angle), unit, family, float(s))
        for k, s in enumerate(deviations, 1)
        for f in ("sin", "cos")
    )


def joint_curve(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the angular error of each joint as a smooth function of its angle, and of all joints together.

    The candidate of all joints detects errors that are too weak to be detected one by one.
    """
    highest = 12 if len(states) < 150 else 40 if len(states) < 600 else 60
    fine, smooth = CURVE_SPREAD * spectrum(highest, CURVE_CORNER), CURVE_SPREAD / 4 * spectrum(*SMOOTH)
    joints, name = revolute(mechanism), "error curve of the angle"
    for j in joints:
        effects = harmonics(f"{name}, {j.name}", Site(j.drive), j.name, "joint_curve", fine)
        yield Candidate(f"{name}, {j.name}", effects, "joint_curve", 6.0)
    block = [harmonics(f"smooth {name}, {j.name}", Site(j.drive), j.name, "joint_curve", smooth) for j in joints]
    if len(block) > 2:
        yield Candidate(f"{name}, every joint", tuple(chain(*block)), "joint_curve", 7.0)


def axis_motion(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield wobble and run-out of each revolute joint on axes other than its drive, as smooth functions of its angle.

    Each ball joint of a machine has a run-out curve along its leg.
    """
    for j in revolute(mechanism):
        for axis in AXES:
            if axis != j.drive[0][1]:
                what, size = ("run-out", RUN_OUT) if axis[0] == "T" else ("wobble", WOBBLE)
                name = f"{what} curve, {j.name} {axis}"
                site = Site(((f"{j.name}.moving", axis, 1.0),))
                effects = harmonics(name, site, j.name, "axis_motion", size * spectrum(*SMOOTH))
                yield Candidate(name, effects, "axis_motion", 6.0)
    for angle, said, site, balls in _machine_balls(mechanism):
        name = f"run-out curve over {angle} {said}"
        effects = harmonics(name, site, angle, "axis_motion", RUN_OUT * spectrum(*SMOOTH))
        yield Candidate(name, effects, "axis_motion", 6.0 + balls)


def backlash_approach(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the play of each drive by the side of approach, ±1, for each table column `approach...`.

    The joint that the name of the column states has the lower penalty.
    """
    declared = declared_approach([j.name for j in mechanism.joints], states.columns)
    for column in states.columns:
        if column.startswith(APPROACH):
            for j in mechanism.joints:
                own = column == declared.get(j.name) != APPROACH
                effect = drive_effect(
                    f"backlash by approach, {j.name} ({column})", j, Expression(column), family="backlash_approach"
                )
                yield one(effect.name, effect, 4.0 if own else 6.0)


def gear_ratio(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield a wrong gear ratio or screw pitch: an error in proportion to the coordinate of the joint."""
    for j in mechanism.joints:
        what = "gear ratio" if j.kind == "revolute" else "screw pitch"
        effect = drive_effect(f"{what}, {j.name}", j, Expression(j.name), "1", "gear_ratio")
        yield one(effect.name, effect, 4.0)


def wrist_coupling(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the error of each revolute joint in proportion to the coordinate of each revolute joint before it.

    The error of a linear joint is proportional to its neighbour's angle, m/rad: a SCARA's spindle is also a screw.
    """
    joints = revolute(mechanism)
    pairs = [
        (source, target, "1", 4.0 if i >= len(joints) - 3 else 5.5)
        for i, source in enumerate(joints)
        for target in joints[i + 1 :]
    ]
    for first, second in pairwise(j for j in mechanism.joints if j.measured):
        if {first.kind, second.kind} == {"revolute", "prismatic"}:
            turning, sliding = (first, second) if first.kind == "revolute" else (second, first)
            pairs.append((turning, sliding, "m/rad", 5.5))
    for source, target, unit, cost in pairs:
        name = f"coupling, {source.name} to {target.name}"
        yield one(name, drive_effect(name, target, Expression(source.name), unit, "wrist_coupling"), cost)


def parallel_bar(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the error of a joint driven through a parallel bar, one period per turn of the driving joint, rad."""
    own = {f"{joint.name}.moving": joint for joint in mechanism.joints}
    for j in mechanism.joints:
        for other in (own[slot] for slot, _, _ in j.drive[1:] if slot in own):
            yield pair(f"parallel-bar closure, {j.name}", other, j.name, "parallel_bar_closure", 4.5)


def axis_wobble(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the tilt of each revolute joint q about the two axes across its own axis: a sin q + b cos q, rad."""
    for j in revolute(mechanism):
        for a in across(j):
            site = Site(((f"{j.name}.moving", f"R{a}", 1.0),))
            yield _phases(f"axis wobble, {j.name} R{a}", site, 1, j.name, "axis_wobble", 5.0)


def run_out(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the shift of each revolute joint along each axis, m, one period per turn (joint not measured: also two).

    Each ball joint of a machine shifts along its leg, one period per turn of each of its angles.
    """
    for angle, said, site, balls in _machine_balls(mechanism):
        yield _phases(f"axis run-out, 1 per turn of {angle}, {said}", site, 1, angle, "axis_run_out", 5.5 + balls)
    for j in revolute(mechanism):
        for a in "xyz":
            for f in ("sin", "cos"):
                name = f"axis run-out, {j.name} T{a}, {f}"
                basis = Expression(f"{f}({j.name})")
                yield one(name, effect_at(name, f"{j.name}.moving", f"T{a}", basis, family="axis_run_out"), 5.5)
            if not j.measured:
                site = Site(((f"{j.name}.moving", f"T{a}", 1.0),))
                yield _phases(f"axis run-out, 2 per turn, {j.name} T{a}", site, 2, j.name, "axis_run_out", 5.5)


def ball_lobes(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the shift of a ball joint by the lobes of its ball, two to four periods per turn of the ball, m."""
    balls = balls_of(mechanism)
    for ball in balls:
        for angle, lobes, (said, shift) in product(ball.angles, LOBES, ball.shifts.items()):
            name = f"out-of-round ball, {lobes} lobes over {angle}, lift {said}"
            yield _phases(name, Site(shift), lobes, angle, "ball_lobes", 5.0 + float(np.log(len(balls))))


def _phases(name: str, site: Site, number: int, angle: str, family: str, cost: float) -> Candidate:
    """Return one candidate effect of sin(number · angle) and cos(number · angle) at a site (frame and axis)."""
    effects = tuple(
        site.effect(f"{name}, {f}", wave(f, number, angle), axis_unit(site.axis), family) for f in ("sin", "cos")
    )
    return Candidate(name, effects, family, cost)


def _machine_balls(mechanism: Mechanism) -> Iterator[tuple[str, str, Site, float]]:
    """Yield each angle of each ball joint of a parallel machine, the direction of the joint's leg as text and as a
    site, and the log of the number of balls."""
    balls = [ball for ball in balls_of(mechanism) if ball.name]
    for ball in balls:
        said, shift = ball.along
        for angle in ball.angles:
            yield angle, said, Site(shift), float(np.log(len(balls)))
