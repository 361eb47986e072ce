"""Families of linear axes, by the names of ISO 230-1: E, the direction of the error, the axis that moves.

EXZ is the straightness in X of an axis along Z, EAZ its tilt about X, ECZ its roll about itself, EZZ its positioning.
Letters are those of the joint's own frame.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from gpmodel.families.candidate import Candidate, pair
from gpmodel.families.frequency_grid import FrequencyGrid, frequency_grid
from gpmodel.families.inner import symbol
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.model.effect import Effect, drive_effect, effect_at
from gpmodel.model.states import States

LENGTH, ANGLE = 5e-5, 5e-5
"""m and rad over the travel: between a machine tool's 10 µm and a robot track's 0.2 mm."""

WAVES = 4
"""Half waves over the travel: guideways bend and sag over parts of their length, not over less than its quarter."""

LEADS = (1, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40)
"""mm, nominal leads of ball screws (ISO 3408-2)."""

SHORTEST = 2e-3
"""m: finer screws drive no robot, and poses repeat to a tenth of it at best."""

TURN = {"x": "A", "y": "B", "z": "C"}


def prismatic(mechanism: Mechanism) -> list[Joint]:
    """The joints that slide."""
    return [j for j in mechanism.joints if j.kind == "prismatic"]


def _travel(joint: Joint, states: States) -> tuple[float, float]:
    values = states[joint.name]
    return float(np.min(values)), float(np.ptp(values))


def linear_curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """The six error motions of each linear axis as smooth curves of its position."""
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
    """sin(π k u) and cos(π k u), k = 1.., u from 0 to 1 over the travel, falling as 1/k.

    Waves over twice the travel: a smooth curve that does not end as it began is short in them, where cosines alone
    fall off as 1/k² (Huybrechs 2010).
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
    """A wave of positioning once every lead of a screw, in the leads of ISO 3408-2 that the travel holds three of."""
    for j in prismatic(mechanism):
        start, travel = _travel(j, states)
        for lead in LEADS:
            if 3e-3 * lead <= travel:
                name = f"cyclic error, every {lead} mm, {j.name}"
                argument = f"{2e3 * np.pi / lead:.8g}*({j.name} - {start:.6g})"
                yield pair(name, j, argument, "cyclic_error", 4.0 + float(np.log(len(LEADS))), LENGTH)


def cyclic_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """A wave of positioning of any period from SHORTEST to a third of the travel: screws, racks, scales."""
    for j in prismatic(mechanism):
        start, travel = _travel(j, states)
        argument = f"{2e3 * np.pi:.8g}/{symbol()}*({j.name} - {start:.6g})"
        wave = pair(f"cyclic error, every {symbol()} mm, {j.name}", j, argument, "cyclic_error", 4.0, LENGTH)
        span = (6 * np.pi / travel if travel > 0 else 0.0, 2 * np.pi / SHORTEST)
        found = frequency_grid(wave, j, (start, travel), span, lambda rate: 2e3 * np.pi / rate)
        if found is not None:
            yield found
