"""Gravity loads against sums of weights and lever arms, and twists against Pinocchio's regressors."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots_cases import CASES, poses, robot, slot_frames

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from robots.chain import SerialChain
from robots.statics import pinocchio_model

PAYLOAD = 12.5


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
