"""Simulate compliance with unknown masses, wrong masses, or measured torques."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from experiments.blind.shapes import Motion, Shape, World, fixed, load_names, turn
from experiments.blind.simulator import Arm, gravity_loads, weight_regressor

CALLED = ("complian", "bending", "stiff", "spring", "elastic", "mass", "gravity", "torque", "load")


def _called(joint: int) -> list[str]:
    return ["*link*mass*", "*mass*link*", *(f"*{word}*j{joint}*" for word in CALLED)]


def largest_torque(arm: Arm, joint: int) -> float:
    """Largest torque about a joint over fixed poses, the natural scale of its loads."""
    q = np.random.default_rng(0).uniform(arm.limits[:, 0], arm.limits[:, 1], (300, len(arm.rows)))
    return float(np.abs(gravity_loads(arm, q).torque[:, joint - 1]).max())


def compliance_unknown(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A weak drive on an arm without masses: the oracle has the torques of unit mass moments of every frame beyond."""

    def basis(w: World) -> list[Motion]:
        return [turn(joint, column) for column in weight_regressor(arm, w.q, joint).T]

    return Shape(lambda w: turn(joint, w.torque(joint)), basis, load_names(joint), {}, _called(joint))


def compliance_reweighed(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A weak drive on an arm whose masses are wrong: the oracle has the torque of each link by itself."""

    def basis(w: World) -> list[Motion]:
        links = np.eye(len(arm.rows))[joint - 1 :]
        return [turn(joint, gravity_loads(arm.heavier(one), w.q).torque[:, joint - 1]) for one in links]

    return Shape(lambda w: turn(joint, w.torque(joint)), basis, load_names(joint), {}, _called(joint))


def compliance_measured(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A weak drive whose torque the controller reports: the oracle has that column, with its noise."""
    told = fixed(lambda w: turn(joint, w.extra[f"torque_J{joint}"]), load_names(joint))
    return Shape(lambda w: turn(joint, -w.torque(joint)), told.basis, told.named, {}, _called(joint))


KINDS: tuple[Callable[..., Shape], ...] = (compliance_unknown, compliance_reweighed, compliance_measured)
