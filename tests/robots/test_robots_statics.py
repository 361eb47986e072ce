"""Test gravity loads against weights and lever arms, and twists against Pinocchio."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots_cases import CASES, poses, robot, slot_frames

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from robots.chain import SerialChain

PAYLOAD = 12.5
MOTIONS = dict(
    zip(
        AXES,
        (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ, pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ),
        strict=True,
    )
)


def pinocchio_model(chain: SerialChain) -> pin.Model:
    """Pinocchio's model of the chain in its own motions (before coupling), with its own masses and the payload's."""
    model = pin.Model()
    model.gravity.linear = chain.gravity
    parent = 0
    for link in chain.links:
        parent = model.addJoint(parent, MOTIONS[link.axis](), pin.SE3(link.placement), link.name)
        model.appendBodyToJoint(parent, pin.Inertia(link.mass, link.com, np.zeros((3, 3))), pin.SE3.Identity())
    model.addFrame(pin.Frame(chain.tool_frame, parent, 0, pin.SE3(chain.tool), pin.FrameType.OP_FRAME))
    return model


@pytest.fixture(params=CASES)
def chain(request: pytest.FixtureRequest, tmp_path: Path) -> SerialChain:
    return robot(request.param, tmp_path)


@pytest.fixture
def q(chain: SerialChain) -> Array:
    return poses(chain, np.random.default_rng(2), 6)


def weights(chain: SerialChain, q: Array) -> tuple[list[Array], Array]:
    """Positions (N, 3) in the root frame of every mass, links in order and the payload last; and the masses."""
    frames = slot_frames(chain, q)
    moving = frames[2:-1:2]
    coms = [frame @ np.append(link.com, 1.0) for frame, link in zip(moving, chain.links, strict=True)]
    coms.append(frames[-1] @ np.append(chain.payload_com, 1.0))
    return [com[:, :3] for com in coms], np.array([*(link.mass for link in chain.links), PAYLOAD])


def test_wrenches_are_sums_of_weights_and_lever_arms(chain: SerialChain, q: Array) -> None:
    loads = chain.loads(q, np.full(len(q), PAYLOAD))
    frames = slot_frames(chain, q)
    positions, masses = weights(chain, q)
    parts = [("base", frames[0], 0)]
    parts += [(link.name, frames[2 + 2 * i], i) for i, link in enumerate(chain.links)]
    for name, frame, first in parts:
        rotation, origin = frame[:, :3, :3], frame[:, :3, 3]
        force = np.broadcast_to(masses[first:].sum() * chain.gravity, origin.shape)
        moment = sum(
            np.cross(position - origin, mass * chain.gravity)
            for position, mass in zip(positions[first:], masses[first:], strict=True)
        )
        expected = np.concatenate(
            [np.einsum("nji,nj->ni", rotation, force), np.einsum("nji,nj->ni", rotation, moment)], axis=1
        )
        for k, kind in enumerate(("force", "moment")):
            for i, side in enumerate("xyz"):
                np.testing.assert_allclose(loads[f"{kind}_{name}_{side}"], expected[:, 3 * k + i], atol=1e-9)


def test_wrenches_are_what_pinocchio_holds_at_rest(chain: SerialChain, q: Array) -> None:
    model = pinocchio_model(chain)
    data, rest = model.createData(), np.zeros(model.nv)
    loads = chain.loads(q, np.zeros(len(q)))
    for row, motion in enumerate(chain.motions(q)):
        pin.rnea(model, data, motion, rest, rest)
        for joint, link in enumerate(chain.links, start=1):
            for k, kind in enumerate(("force", "moment")):
                for i, side in enumerate("xyz"):
                    name = f"{kind}_{link.name}_{side}"
                    ours = loads[name][row] if loads else 0.0
                    np.testing.assert_allclose(-data.f[joint].vector[3 * k + i], ours, atol=1e-9)


def test_torque_is_minus_the_slope_of_the_potential_energy(chain: SerialChain, q: Array) -> None:
    def energy(at: Array) -> Array:
        positions, masses = weights(chain, at)
        return -sum(mass * position @ chain.gravity for position, mass in zip(positions, masses, strict=True))

    loads = chain.loads(q, np.full(len(q), PAYLOAD))
    for column, name in enumerate(chain.joint_names):
        step = np.zeros(q.shape[1])
        step[column] = 1e-5
        slope = (energy(q + step) - energy(q - step)) / 2e-5
        np.testing.assert_allclose(loads[f"torque_{name}"], -slope, atol=2e-6)


def test_unit_twists_agree_with_the_kinematic_regressor(chain: SerialChain, q: Array) -> None:
    """Twist at NAME.fixed, carried to the tool = Pinocchio's block of that joint, in the frame of the tool."""
    model = pinocchio_model(chain)
    data = model.createData()
    tool = model.getFrameId(chain.tool_frame)
    frames = slot_frames(chain, q)
    for row, motion in enumerate(chain.motions(q)):
        pin.forwardKinematics(model, data, motion)
        pin.updateFramePlacements(model, data)
        np.testing.assert_allclose(data.oMf[tool].homogeneous, frames[-1, row], atol=1e-12)
        regressor = pin.computeFrameKinematicRegressor(model, data, tool, pin.LOCAL)
        for joint, link in enumerate(chain.links):
            slot = chain.slots.index(f"{link.name}.fixed")
            carried = np.linalg.inv(frames[-1, row]) @ frames[slot, row]
            block = regressor[:, 6 * joint : 6 * joint + 6]
            np.testing.assert_allclose(pin.SE3(carried).action, block, atol=1e-9)
            assert block.shape == (6, len(AXES))


def test_without_masses_nothing_loads_until_there_is_a_payload(tmp_path: Path) -> None:
    path = tmp_path / "light.toml"
    path.write_text('convention = "modified"\n[[joint]]\na_mm = 0\n[[joint]]\na_mm = 500\n')
    chain = robot(str(path), tmp_path)
    q = np.zeros((3, 2))
    assert chain.loads(q, np.zeros(3)) == {}
    np.testing.assert_allclose(chain.loads(q, np.array([0.0, 1.0, 2.0]))["force_base_z"], [0.0, -9.81, -19.62])


def test_unit_loads_are_pinocchios_regressor_at_rest(chain: SerialChain, q: Array) -> None:
    model = pinocchio_model(chain)
    data, rest = model.createData(), np.zeros(model.nv)
    unit = chain.unit_loads(q)
    for row, motion in enumerate(chain.motions(q)):
        regressor = -pin.computeJointTorqueRegressor(model, data, motion, rest, rest)
        per_joint = chain.coupling.T @ regressor
        for c, joint in enumerate(chain.joint_names):
            for k, link in enumerate(chain.links):
                for a, side in enumerate("xyz"):
                    values = unit.get(f"torque_{joint}_of_{link.name}_{side}", np.zeros(len(q)))
                    assert values[row] == pytest.approx(per_joint[c, 10 * k + 1 + a], abs=1e-8)


def test_the_weights_of_the_links_add_up_to_the_loads(chain: SerialChain, q: Array) -> None:
    loads, unit = chain.loads(q, np.zeros(len(q))), chain.unit_loads(q)
    for joint in chain.joint_names:
        parts = [unit[n] for link in chain.links if (n := f"torque_{joint}_of_{link.name}") in unit]
        np.testing.assert_allclose(sum(parts, np.zeros(len(q))), loads.get(f"torque_{joint}", 0.0), atol=1e-8)


def test_every_torque_about_a_turning_joint_is_a_combination_of_unit_moments(chain: SerialChain) -> None:
    q = poses(chain, np.random.default_rng(5), 60)
    loads, unit = chain.loads(q, np.full(len(q), PAYLOAD)), chain.unit_loads(q)
    for joint in chain.joints:
        if joint.kind == "revolute" and len(joint.drive) == 1 and chain.coupling.shape[0] == chain.coupling.shape[1]:
            named = [f"torque_{joint.name}_of_{link.name}_{side}" for link in chain.links for side in "xyz"]
            moments = np.column_stack([np.zeros(len(q)), *(unit[n] for n in named if n in unit)])
            torque = loads[f"torque_{joint.name}"]
            miss = torque - moments @ np.linalg.lstsq(moments, torque, rcond=1e-10)[0]
            if not any(link.axis.startswith("T") for link in chain.links):
                assert np.abs(miss).max() < 1e-6 * max(np.abs(torque).max(), 1.0)
