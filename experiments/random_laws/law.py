"""A law over named columns, and the place of the machine where it acts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.blind.oracle import sensitivities
from experiments.blind.shapes import Motion
from experiments.blind.simulator import Arm, Array

AXES = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")
_FUNCTIONS = {
    name: getattr(np, name)
    for name in ("abs", "arctan", "exp", "hypot", "log", "maximum", "minimum", "sign", "sin", "sinc", "sqrt")
}


@dataclass(frozen=True)
class Law:
    """text: in u, with more inputs in v and w; u = (first input - middle) / half, which runs over [-1, 1]."""

    text: str
    inputs: tuple[str, ...]
    middle: tuple[float, ...]
    half: tuple[float, ...]

    def scaled(self, columns: Any) -> list[Array]:
        """u, v and w (N,) from the columns of the inputs; beyond the ranges they were drawn with stay at the edge."""
        scales = zip(self.inputs, self.middle, self.half, strict=True)
        return [np.clip((columns[name] - middle) / half, -1.0, 1.0) for name, middle, half in scales]

    def __call__(self, columns: Any) -> Array:
        """(N,) values from the columns of the inputs."""
        values = dict(zip("uvw", self.scaled(columns), strict=False))
        return np.asarray(eval(self.text, {"__builtins__": {}}, {**_FUNCTIONS, **values}))

    def __str__(self) -> str:
        parts = zip("uvw", self.inputs, self.middle, self.half, strict=False)
        return f"{self.text} with " + ", ".join(f"{x} = ({n} - {m:.6g})/{h:.6g}" for x, n, m, h in parts)


@dataclass(frozen=True)
class Place:
    """An axis of a slot: `base`, `J3.fixed` (before the joint moves), `J3.moving` (after) or `tool`."""

    slot: str
    axis: str

    def motion(self, arm: Arm, phi: Array) -> Motion:
        """Small motions of the simulator's frames, phi (N,) in m or rad along the axis.

        A motion xi before joint i moves is one of the frame i - 1 by (R v + p x R w, R w), with R and p the joint's
        origin in that frame.
        """
        twist = np.zeros((len(phi), 6))
        twist[:, AXES.index(self.axis)] = phi
        if self.slot in ("base", "tool"):
            return {0 if self.slot == "base" else len(arm.rows): twist}
        joint, side = int(self.slot[1:].split(".")[0]), self.slot.split(".")[1]
        if side == "moving":
            return {joint: twist}
        origin = arm.origins()[joint - 1]
        turned = twist.reshape(-1, 2, 3) @ origin[:3, :3].T
        return {joint - 1: np.hstack([turned[:, 0] + np.cross(origin[:3, 3], turned[:, 1]), turned[:, 1]])}

    def column(self, arm: Arm, tool: Array, q: Array) -> Array:
        """(N, 3) how the tool point moves by a unit motion here, in the base's frame."""
        by_twist = sensitivities(arm, np.eye(4), tool, q, {})
        moved = self.motion(arm, np.ones(len(q)))
        return np.asarray(sum(np.einsum("nij,nj->ni", by_twist[slot], twist) for slot, twist in moved.items()))


def places(arm: Arm) -> list[Place]:
    """Both sides of every joint and the base in six axes, the tool in three."""
    slots = ["base", *(f"J{i + 1}.{side}" for i in range(len(arm.rows)) for side in ("fixed", "moving"))]
    return [*(Place(slot, axis) for slot in slots for axis in AXES), *(Place("tool", axis) for axis in AXES[:3])]


def drawn_law(text: str, inputs: tuple[str, ...], ranges: Mapping[str, tuple[float, float]]) -> Law:
    """The law with its inputs scaled by their ranges."""
    bounds = [ranges[name] for name in inputs]
    return Law(text, inputs, tuple((a + b) / 2 for a, b in bounds), tuple((b - a) / 2 for a, b in bounds))
