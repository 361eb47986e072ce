"""Simulate errors of linear axes by ISO 230-1: straightness, pitch, yaw and roll, cyclic positioning.

A scale error of the positioning (the screw's pitch) is `gear_ratio`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from experiments.blind.shapes import Motion, Shape, World, Z, fixed, mixed, turn
from experiments.blind.simulator import Arm


def guideway(arm: Arm, rng: np.random.Generator, joint: int, axis: int, waves: int = 2) -> Shape:
    """A carriage strays with its position: sideways (axis 0, 1) or turning (3 to 5), in 1..waves half waves.

    sin(pi k u), cos(pi k u), k = 1..waves, u from 0 to 1 over the travel: straightness E_xz, E_yz, pitch and yaw E_az,
    E_bz and roll E_cz of an axis along z.
    """
    low, high = arm.limits[joint - 1]
    orders = np.arange(1, waves + 1)
    weights = (rng.normal(size=(2, waves)) / orders).ravel()

    def basis(w: World) -> list[Motion]:
        u = np.pi * (w.angle(joint) - low) / (high - low)
        return [turn(joint, wave(k * u), axis) for wave in (np.sin, np.cos) for k in orders]

    return mixed(basis, weights, [[f"J{joint}"]], axis=axis)


def cyclic(arm: Arm, rng: np.random.Generator, joint: int, lead: float) -> Shape:
    """A screw off its centre: a sine of the position with the lead, in metres a turn, as its period."""
    phase = rng.uniform(0, 2 * np.pi)

    def basis(w: World) -> list[Motion]:
        angle = 2 * np.pi * w.angle(joint) / lead
        return [turn(joint, np.sin(angle), Z), turn(joint, np.cos(angle), Z)]

    return mixed(basis, np.array([np.cos(phase), np.sin(phase)]), [[f"J{joint}"]], lead=lead, phase=phase)


def sag(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A beam sags under the carriage: one minus a squared distance to the middle of the travel, along x."""
    low, high = arm.limits[joint - 1]
    return fixed(
        lambda w: turn(joint, 1.0 - (2.0 * (w.angle(joint) - low) / (high - low) - 1.0) ** 2, 0), [[f"J{joint}"]]
    )


KINDS: tuple[Callable[..., Shape], ...] = (guideway, cyclic, sag)
