"""Gravity loads of a serial chain at rest, by Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from gpmodel.mechanism.quantities import GRAVITY
from gpmodel.numerics import se3
from robots.links import Chain

DOWN = (0.0, 0.0, -GRAVITY)
ROUNDING = 1e-9
"""N·m; less than this at every pose is zero."""

_COMPONENTS = ("force_{}_x", "force_{}_y", "force_{}_z", "moment_{}_x", "moment_{}_y", "moment_{}_z")
_JOINT_MODELS = {
    "Tx": pin.JointModelPX,
    "Ty": pin.JointModelPY,
    "Tz": pin.JointModelPZ,
    "Rx": pin.JointModelRX,
    "Ry": pin.JointModelRY,
    "Rz": pin.JointModelRZ,
}


def pinocchio_model(chain: Chain, payload: float | None = None) -> pin.Model:
    """Pinocchio's model of the chain in its own motions (before coupling), joint frames as the slots.

    payload: None for the chain's own masses; else kg at the payload's centre of mass and nothing besides.
    The measured frame is the model's last frame.
    """
    model = pin.Model()
    model.name = chain.name
    model.gravity.linear = chain.gravity
    parent = 0
    for link in chain.links:
        parent = model.addJoint(parent, _JOINT_MODELS[link.axis](), pin.SE3(link.placement), link.name)
        if payload is None and link.mass:
            model.appendBodyToJoint(parent, _point_mass(link.mass, link.com), pin.SE3.Identity())
    if payload:
        com = chain.tool[:3, :3] @ chain.payload_com + chain.tool[:3, 3]
        model.appendBodyToJoint(parent, _point_mass(payload, com), pin.SE3.Identity())
    model.addFrame(pin.Frame(chain.tool_frame, parent, 0, pin.SE3(chain.tool), pin.FrameType.OP_FRAME))
    return model


def gravity_loads(chain: Chain, q: Array, payload: Array) -> dict[str, Array]:
    """SerialChain.loads: linear in the masses, so those of the links plus payload times those of 1 kg."""
    motions = chain.motions(q)
    payload = np.broadcast_to(np.asarray(payload, dtype=np.float64), len(motions))
    wrenches = np.zeros((len(motions), len(chain.links) + 1, 6))
    weighs = any(link.mass for link in chain.links)
    if weighs:
        wrenches += _wrenches(pinocchio_model(chain), motions)
    if np.any(payload != 0.0):
        wrenches += payload[:, None, None] * _wrenches(pinocchio_model(chain, payload=1.0), motions)
    elif not weighs:
        return {}
    return _named(chain, wrenches)


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
        centre = frames[k][:, :3, :3] @ link.com + frames[k][:, :3, 3]
        couples = [np.cross(centre - frames[j][:, :3, 3], weight) for j in range(k + 1)]
        out |= _on_joints(chain, [_on_motion(chain, axes, j, c, weight) for j, c in enumerate(couples)], link.name)
    return {name: values for name, values in out.items() if np.any(np.abs(values) > ROUNDING)}


def _on_motion(chain: Chain, axes: list[Array], j: int, couple: Array, weight: Array | float = 0.0) -> Array:
    """Generalized force (N,) on motion j of a couple (N, 3) or, where it slides, of a weight (3,)."""
    acting = couple if chain.links[j].axis.startswith("R") else np.broadcast_to(weight, couple.shape)
    return np.einsum("ni,ni->n", axes[j], acting)


def _on_joints(chain: Chain, on_motions: list[Array], part: str) -> dict[str, Array]:
    """Generalized forces (N,) on the coordinates, of those on the first motions; the others bear none."""
    torques = np.stack(on_motions, axis=1) @ chain.coupling[: len(on_motions)]
    return {f"torque_{name}_of_{part}": torques[:, c] for c, name in enumerate(chain.joint_names)}


def _point_mass(mass: float, com: Array) -> pin.Inertia:
    return pin.Inertia(mass, np.asarray(com, dtype=np.float64), np.zeros((3, 3)))


def _wrenches(model: pin.Model, motions: Array) -> Array:
    """Wrenches (N, 1 + joints, 6) of gravity on the base and on each joint, in the frame after its motion."""
    data = model.createData()
    at_rest = np.zeros(model.nv)
    joints = range(1, model.njoints)
    wrenches = np.empty((len(motions), model.njoints, 6))
    for row, motion in zip(wrenches, motions, strict=True):
        pin.rnea(model, data, motion, at_rest, at_rest)
        for joint in joints:
            row[joint] = data.f[joint].vector
        row[0] = data.liMi[1].act(data.f[1]).vector
    return -wrenches


def _named(chain: Chain, wrenches: Array) -> dict[str, Array]:
    along = [wrenches[:, i + 1, AXES.index(link.axis)] for i, link in enumerate(chain.links)]
    torques = np.stack(along, axis=1) @ chain.coupling
    named = {f"torque_{name}": torques[:, column] for column, name in enumerate(chain.joint_names)}
    for i, name in enumerate(("base", *(link.name for link in chain.links))):
        named |= {text.format(name): wrenches[:, i, k] for k, text in enumerate(_COMPONENTS)}
    return named
