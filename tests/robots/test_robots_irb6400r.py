"""The coded IRB 6400R against its Denavit-Hartenberg table, its dimensions and its parallel bar."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from robots_cases import poses, slot_frames

from robots.dh import read_dh
from robots.library import irb6400r


@pytest.fixture
def rows() -> Path:
    return Path(str(files("robots.data") / "irb6400r.toml"))


def test_agrees_with_its_modified_dh_rows_to_rounding(rows: Path) -> None:
    coded, table = irb6400r(), read_dh(rows)
    q = poses(coded, np.random.default_rng(3), 200)
    flange, last_row = slot_frames(coded, q)[-1], slot_frames(table, q)[-1]
    np.testing.assert_allclose(flange[:, :3, 3], last_row[:, :3, 3], rtol=0, atol=4e-15)
    turn = last_row[0, :3, :3].T @ flange[0, :3, :3]
    np.testing.assert_allclose(last_row[:, :3, :3] @ turn, flange[:, :3, :3], atol=4e-15)


def test_both_descriptions_weigh_the_same(rows: Path) -> None:
    coded, table = irb6400r(), read_dh(rows)
    q = poses(coded, np.random.default_rng(4), 20)
    coded_loads, table_loads = (arm.loads(q, np.full(20, 60.0)) for arm in (coded, table))
    for name in (*(f"torque_{joint.name}" for joint in coded.joints), "moment_base_x", "moment_base_y"):
        np.testing.assert_allclose(coded_loads[name], table_loads[name], atol=1e-8)
    for joint, row in zip(coded.joints, table.joints, strict=True):
        assert (joint.name, joint.lower, joint.upper) == (row.name, row.lower, row.upper)


@pytest.mark.parametrize(
    ("name", "reach"), [("irb6400r", 0.240 + 1.175 + 0.200), ("irb6400r-2.8", 0.240 + 1.520 + 0.200)]
)
def test_stands_upright_at_zero(name: str, reach: float) -> None:
    flange = slot_frames(irb6400r(name), np.zeros((1, 6)))[-1, 0]
    np.testing.assert_allclose(flange[:3, 3], [reach, 0.0, 0.800 + 1.050 + 0.225], atol=1e-15)
    np.testing.assert_array_equal(flange[:3, :3], np.eye(3))


def test_parallel_bar_keeps_the_upper_arm_at_its_angle_to_the_ground() -> None:
    arm = irb6400r()
    q = np.array([[0.3, angle, 0.4, 0.1, 0.2, 0.5] for angle in (-0.5, 0.0, 0.9)])
    orientations = slot_frames(arm, q)[-1, :, :3, :3]
    np.testing.assert_allclose(orientations, np.broadcast_to(orientations[0], orientations.shape), atol=1e-15)
    assert arm.joints[1].drive == (("J2.moving", "Ry", 1.0), ("J3.moving", "Ry", -1.0))
    assert arm.joints[2].drive == (("J3.moving", "Ry", 1.0),)


def test_the_motor_of_axis_two_does_not_carry_the_upper_arms_moment() -> None:
    loads = irb6400r().loads(np.array([[0.0, 0.6, 0.3, 0.0, 0.4, 0.0]]), np.array([150.0]))
    np.testing.assert_allclose(loads["torque_J2"], loads["moment_J2_y"] - loads["moment_J3_y"], rtol=1e-14)
    beyond = 149.3 + 10.2 + 17.7 + 41.5 + 150.0
    lever = np.sin(0.6) * (156.2 * 0.525 + beyond * 1.050)
    np.testing.assert_allclose(loads["torque_J2"], 9.81 * lever, rtol=1e-12)
