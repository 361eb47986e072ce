"""Test the contract of every mechanism over a table of robots."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from robots_cases import CASES, poses, robot, slot_frames

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES, GRAVITY, ExportsUrdf, Mechanism
from joints import spherical_joint
from robots import load_mechanism

SIDES = ("x", "y", "z")


@pytest.fixture(params=CASES)
def mechanism(request: pytest.FixtureRequest, tmp_path: Path) -> Mechanism:
    return robot(request.param, tmp_path)


@pytest.fixture
def q(mechanism: Mechanism) -> Array:
    return poses(mechanism, np.random.default_rng(1))


def unit_twist(slot_frame: Array, axis: str) -> Array:
    """Change rate (N, 4, 4), in root coordinates, of whatever follows a unit twist at the slot."""
    k = AXES.index(axis)
    rate = np.zeros((4, 4))
    if k < 3:
        rate[k, 3] = 1.0
    else:
        i, j = (k - 2) % 3, (k - 1) % 3
        rate[j, i], rate[i, j] = 1.0, -1.0
    return slot_frame @ rate @ np.linalg.inv(slot_frame)


def test_slots_are_base_both_sides_of_each_joint_and_tool(mechanism: Mechanism) -> None:
    assert (mechanism.slots[0], mechanism.slots[-1]) == ("base", "tool")
    names = [slot.removesuffix(".fixed") for slot in mechanism.slots[1:-1:2]]
    assert mechanism.slots[1:-1] == tuple(f"{name}.{side}" for name in names for side in ("fixed", "moving"))
    assert {joint.name for joint in mechanism.joints} <= set(names)
    assert len(set(mechanism.slots)) == len(mechanism.slots)


def test_joints_state_kind_limits_and_a_drive_on_slots_that_exist(mechanism: Mechanism) -> None:
    for joint in mechanism.joints:
        assert joint.kind in ("revolute", "prismatic")
        assert joint.lower < joint.upper
        assert {slot for slot, _, _ in joint.drive} <= set(mechanism.slots)
        assert {axis[0] for _, axis, _ in joint.drive} <= ({"R"} if joint.kind == "revolute" else {"T"})


def test_transforms_are_rigid_and_each_pose_is_on_its_own(mechanism: Mechanism, q: Array) -> None:
    transforms = mechanism.transforms(q)
    assert transforms.shape == (len(mechanism.slots), len(q), 4, 4)
    rotations = transforms[..., :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.swapaxes(-1, -2), np.broadcast_to(np.eye(3), rotations.shape), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-14)
    np.testing.assert_array_equal(transforms[..., 3, :], np.broadcast_to([0, 0, 0, 1], transforms.shape[:-1]))
    np.testing.assert_array_equal(mechanism.transforms(q[3:5]), transforms[:, 3:5])
    assert mechanism.transforms(q[:0]).shape == (len(mechanism.slots), 0, 4, 4)


def test_drive_is_the_derivative_of_the_pose(mechanism: Mechanism, q: Array) -> None:
    frames = slot_frames(mechanism, q)
    for column, joint in enumerate(mechanism.joints):
        step = np.zeros(q.shape[1])
        step[column] = 1e-6
        numeric = (slot_frames(mechanism, q + step)[-1] - slot_frames(mechanism, q - step)[-1]) / 2e-6
        rate = sum(weight * unit_twist(frames[mechanism.slots.index(slot)], axis) for slot, axis, weight in joint.drive)
        np.testing.assert_allclose(rate @ frames[-1], numeric, atol=1e-8)


def test_loads_have_a_torque_for_each_joint_and_a_wrench_for_each_part(mechanism: Mechanism, q: Array) -> None:
    loads = mechanism.loads(q, np.full(len(q), 5.0))
    parts = {"base", *(slot.removesuffix(".fixed") for slot in mechanism.slots[1:-1:2])}
    wrenches = {f"{kind}_{part}_{side}" for kind in ("force", "moment") for part in parts for side in SIDES}
    assert set(loads) == {f"torque_{joint.name}" for joint in mechanism.joints} | wrenches
    assert all(load.shape == (len(q),) and np.all(np.isfinite(load)) for load in loads.values())


def test_loads_are_linear_in_the_payload_of_each_row(mechanism: Mechanism, q: Array) -> None:
    payload = np.linspace(0.0, 60.0, len(q))
    mixed, full = mechanism.loads(q, payload), mechanism.loads(q, np.full(len(q), 60.0))
    empty = mechanism.loads(q, np.zeros(len(q)))
    for name, load in mixed.items():
        bare = empty[name] if empty else np.zeros(len(q))
        np.testing.assert_allclose(load, bare + payload / 60.0 * (full[name] - bare), atol=1e-9)


def test_torque_is_what_the_drive_collects_of_the_wrenches(mechanism: Mechanism, q: Array) -> None:
    loads = mechanism.loads(q, np.full(len(q), 12.0))
    for joint in mechanism.joints:
        work = np.zeros(len(q))
        for slot, axis, weight in joint.drive:
            kind = "moment" if axis.startswith("R") else "force"
            work += weight * loads[f"{kind}_{slot.removesuffix('.moving')}_{axis[1]}"]
        np.testing.assert_allclose(loads[f"torque_{joint.name}"], work, rtol=1e-12, atol=1e-12)


def test_survives_pickling_for_the_workers(mechanism: Mechanism, q: Array) -> None:
    copy = pickle.loads(pickle.dumps(mechanism))
    assert copy.slots == mechanism.slots
    np.testing.assert_array_equal(copy.transforms(q), mechanism.transforms(q))


def test_a_payload_on_a_horizontal_arm_pushes_the_coordinate_that_lowers_it_up() -> None:
    """At zero the forearm of this robot is level; J3 and J5 are counted positive downwards. Its bar keeps J2 out."""
    arm = load_mechanism("irb6400r")
    torque = arm.loads(np.zeros((1, 6)), np.array([10.0]))
    bare = arm.loads(np.zeros((1, 6)), np.zeros(1))
    added = {name: float(torque[name][0] - bare[name][0]) for name in torque}
    assert added["torque_J3"] == pytest.approx(10.0 * GRAVITY * 1.375)
    assert added["torque_J5"] == pytest.approx(10.0 * GRAVITY * 0.200)
    assert added["force_base_z"] == pytest.approx(-10.0 * GRAVITY)
    assert added["torque_J2"] == pytest.approx(0.0, abs=1e-9)


def test_what_can_be_exported_says_so_in_its_type() -> None:
    assert isinstance(load_mechanism("irb6400r"), ExportsUrdf)
    assert not isinstance(spherical_joint(), ExportsUrdf)
