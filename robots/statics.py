"""Gravity loads of a serial chain at rest."""

from __future__ import annotations

import numpy as np

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from gpmodel.numerics import se3
from robots.links import Chain

ROUNDING = 1e-9
"""N·m; less than this at every pose is zero."""

_COMPONENTS = ("force_{}_x", "force_{}_y", "force_{}_z", "moment_{}_x", "moment_{}_y", "moment_{}_z")


def gravity_loads(chain: Chain, q: Array, payload: Array) -> dict[str, Array]:
    """SerialChain.loads: force R' M g and moment R' (S - M p) x g of the mass M (N,) beyond a joint, kg, and its first
    moment S (N, 3), kg m, about the root; R and p of the frame after the joint's motion. Root frame throughout."""
    payload = np.asarray(payload, dtype=np.float64)
    if not any(link.mass for link in chain.links) and not np.any(payload):
        return {}
    frames = se3.chain(chain.transforms(q))
    mass = np.broadcast_to(payload, len(frames[0]))
    first = mass[:, None] * _points(frames[-1], chain.payload_com)
    wrenches = []
    for link, frame in zip(reversed(chain.links), reversed(frames[2:-1:2]), strict=True):
        mass, first = mass + link.mass, first + link.mass * _points(frame, link.com)
        wrenches.append(_weight(chain, frame, mass, first))
    wrenches.append(_weight(chain, frames[0], mass, first))
    return _named(chain, np.stack(wrenches[::-1], axis=1))


def _points(frames: Array, point: Array) -> Array:
    """A point (3,) of each frame (N, 4, 4), (N, 3) in the root frame, m."""
    return frames[:, :3, :3] @ point + frames[:, :3, 3]


def _weight(chain: Chain, frame: Array, mass: Array, first: Array) -> Array:
    """Wrench (N, 6), N and N m, of a mass (N,) with a first moment (N, 3) at and in the frame (N, 4, 4)."""
    moment = np.cross(first - mass[:, None] * frame[:, :3, 3], chain.gravity)
    return np.concatenate([(v[:, None] @ frame[:, :3, :3])[:, 0] for v in (mass[:, None] * chain.gravity, moment)], 1)


def unit_loads(chain: Chain, q: Array) -> dict[str, Array]:
    """SerialChain.unit_loads.

    A first moment e_a carried by link k weighs as the couple (R_k e_a) x g on every turning joint j <= k; a mass m at c
    as the torque z_j . (c - p_j) x m g, and as the force z_j . m g on a sliding one. Root frame throughout.
    """
    frames = se3.chain(chain.transforms(q))[2:-1:2]
    axes = [frames[j][:, :3, AXES.index(link.axis) % 3] for j, link in enumerate(chain.links)]
    out: dict[str, Array] = {}
    for k, link in enumerate(chain.links):
        for a, side in enumerate("xyz"):
            couple = np.cross(frames[k][:, :3, a], chain.gravity)
            turned = [_on_motion(chain, axes, j, couple) for j in range(k + 1)]
            out |= _on_joints(chain, turned, f"{link.name}_{side}")
            out |= {f"moment_base_{b}_of_{link.name}_{side}": couple[:, i] for i, b in enumerate("xyz")}
        weight = link.mass * chain.gravity
        centre = _points(frames[k], link.com)
        couples = [np.cross(centre - frames[j][:, :3, 3], weight) for j in range(k + 1)]
        out |= _on_joints(chain, [_on_motion(chain, axes, j, c, weight) for j, c in enumerate(couples)], link.name)
    return {name: values for name, values in out.items() if np.any(np.abs(values) > ROUNDING)}


def _on_motion(chain: Chain, axes: list[Array], j: int, couple: Array, weight: Array | float = 0.0) -> Array:
    """Generalized force (N,) on motion j of a couple (N, 3) or, where it slides, of a weight (3,)."""
    acting = couple if chain.links[j].axis.startswith("R") else np.broadcast_to(weight, couple.shape)
    return np.asarray(np.einsum("ni,ni->n", axes[j], acting))


def _on_joints(chain: Chain, on_motions: list[Array], part: str) -> dict[str, Array]:
    """Generalized forces (N,) on the coordinates, of those on the first motions; the others bear none."""
    torques = np.stack(on_motions, axis=1) @ chain.coupling[: len(on_motions)]
    return {f"torque_{name}_of_{part}": torques[:, c] for c, name in enumerate(chain.joint_names)}


def _named(chain: Chain, wrenches: Array) -> dict[str, Array]:
    along = [wrenches[:, i + 1, AXES.index(link.axis)] for i, link in enumerate(chain.links)]
    torques = np.stack(along, axis=1) @ chain.coupling
    named = {f"torque_{name}": torques[:, column] for column, name in enumerate(chain.joint_names)}
    for i, name in enumerate(("base", *(link.name for link in chain.links))):
        named |= {text.format(name): wrenches[:, i, k] for k, text in enumerate(_COMPONENTS)}
    return named
