"""Families of effects that follow the joints' own angles: gears, encoders, bearings, couplings."""

from collections.abc import Iterator

import numpy as np

from gpmodel.families.candidate import Candidate, across, one, pair, revolute
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import drive_effect, effect_at
from gpmodel.model.states import States

CURVE_SPREAD = 5e-4
CURVE_CORNER = 15.0


def eccentricity(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in revolute(mechanism):
        yield pair(f"eccentricity, 1 per turn, {j.name}", j, j.name, "eccentricity", 4.0)


def gear_harmonic(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in revolute(mechanism):
        yield pair(f"gear error, 2 per turn, {j.name}", j, f"2*{j.name}", "gear_harmonic", 4.5)


def transmission_ripple(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    highest = 12 if len(states) < 300 else 400
    for j in revolute(mechanism):
        for n in range(3, highest + 1):
            cost = 4.0 + np.log(highest)
            yield pair(f"transmission ripple, {n} per turn, {j.name}", j, f"{n}*{j.name}", "transmission_ripple", cost)


def joint_curve(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    highest = 12 if len(states) < 150 else 40 if len(states) < 600 else 60
    k = np.arange(1, highest + 1)
    shape = 1.0 / (1.0 + (k / CURVE_CORNER) ** 1.5)
    for spread in (CURVE_SPREAD, CURVE_SPREAD / 4):
        deviation = spread * shape / np.sqrt(np.sum(shape**2))
        for j in revolute(mechanism):
            name = f"error curve of the angle, {j.name}"
            effects = tuple(
                drive_effect(
                    f"{name}, {f} {n}", j, Expression(f"{f}({n}*{j.name})"), family="joint_curve", prior=float(s)
                )
                for n, s in zip(k, deviation, strict=True)
                for f in ("sin", "cos")
            )
            yield Candidate(name, effects, "joint_curve", 6.0)


def backlash_approach(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for column in states.columns:
        if column.startswith("approach"):
            for i, j in enumerate(mechanism.joints, 1):
                own = column in (f"approach_{j.name}", f"approach_J{i}")
                effect = drive_effect(
                    f"backlash by approach, {j.name} ({column})", j, Expression(column), family="backlash_approach"
                )
                yield one(effect.name, effect, 4.0 if own else 6.0)


def gear_ratio(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        effect = drive_effect(f"gear ratio, {j.name}", j, Expression(j.name), "1", "gear_ratio")
        yield one(effect.name, effect, 4.0)


def wrist_coupling(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    joints = revolute(mechanism)
    for i, source in enumerate(joints):
        for target in joints[i + 1 :]:
            effect = drive_effect(
                f"coupling, {source.name} to {target.name}", target, Expression(source.name), "1", "wrist_coupling"
            )
            yield one(effect.name, effect, 4.0 if i >= len(joints) - 3 else 5.5)


def parallel_bar(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in mechanism.joints:
        for slot, _, _ in j.drive[1:]:
            other = next(o for o in mechanism.joints if slot == f"{o.name}.moving")
            yield pair(f"parallel-bar closure, {j.name}", other, j.name, "parallel_bar_closure", 4.5)


def axis_wobble(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in revolute(mechanism):
        for a in across(j):
            name = f"axis wobble, {j.name} R{a}"
            effects = tuple(
                effect_at(
                    f"{name}, {f}", f"{j.name}.moving", f"R{a}", Expression(f"{f}({j.name})"), family="axis_wobble"
                )
                for f in ("sin", "cos")
            )
            yield Candidate(name, effects, "axis_wobble", 5.0)


def run_out(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for j in revolute(mechanism):
        for a in "xyz":
            for f in ("sin", "cos"):
                name = f"axis run-out, {j.name} T{a}, {f}"
                basis = Expression(f"{f}({j.name})")
                yield one(name, effect_at(name, f"{j.name}.moving", f"T{a}", basis, family="axis_run_out"), 5.5)
            if not j.measured:
                name = f"axis run-out, 2 per turn, {j.name} T{a}"
                effects = tuple(
                    effect_at(
                        f"{name}, {f}",
                        f"{j.name}.moving",
                        f"T{a}",
                        Expression(f"{f}(2*{j.name})"),
                        family="axis_run_out",
                    )
                    for f in ("sin", "cos")
                )
                yield Candidate(name, effects, "axis_run_out", 5.5)


def ball_lobes(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
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
