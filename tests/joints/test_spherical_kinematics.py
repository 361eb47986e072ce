"""The thirty parameters: thesis order, exact kinematics, the engine's columns, loads."""

from dataclasses import replace

import numpy as np
import pytest
from spherical_cases import JOINT

from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.mechanism.quantities import GRAVITY
from gpmodel.mechanism.source import load_mechanism
from gpmodel.numerics import se3
from joints.budget import thesis_columns
from joints.kinematics import FRAMES, PARAMETERS, THESIS_PARAMETERS, parameter, tooling_ball_position

BALL = np.asarray(JOINT.tooling_ball)
POSES = np.random.default_rng(0).uniform(-1.2, 1.2, (40, 3))


def elementary(axis: int, value: float) -> np.ndarray:
    twist = np.zeros(6)
    twist[axis] = value
    return se3.exp(twist)


def thesis_product(q: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Figures 3.13 and 3.14 literally: five frames, each Trans Rx Ry Rz with its own joint angle in its own entry."""
    frame = np.eye(4)
    for i in range(len(FRAMES)):
        entries = parameters[6 * i : 6 * i + 6].copy()
        if 1 <= i <= 3:
            entries[2 + i] += q[i - 1]
        if i == 4:
            entries[:3] += BALL
        for axis, value in enumerate(entries):
            frame = frame @ elementary(axis, value)
    return frame[:3, 3]


def test_extended_kinematics_is_the_product_of_the_five_frames() -> None:
    rng = np.random.default_rng(1)
    parameters = np.where(np.arange(PARAMETERS) % 6 < 3, 0.01, 0.3) * rng.standard_normal((40, PARAMETERS))
    expected = [thesis_product(q, p) for q, p in zip(POSES, parameters, strict=True)]
    np.testing.assert_allclose(tooling_ball_position(POSES, parameters, BALL), expected, atol=1e-15)


def test_without_errors_it_is_the_mechanism() -> None:
    tip = se3.chain(JOINT.transforms(POSES))[-1][:, :3, 3]
    np.testing.assert_allclose(tooling_ball_position(POSES, np.zeros(PARAMETERS), BALL), tip, atol=1e-16)


def test_parameters_are_in_the_order_of_the_thesis() -> None:
    assert [p.index for p in THESIS_PARAMETERS] == list(range(1, 31))
    assert all(p.axis == AXES[(p.index - 1) % 6] and p.frame == FRAMES[(p.index - 1) // 6] for p in THESIS_PARAMETERS)
    named = {
        11: ("Ts_Tbr", "Ry"),
        14: ("Tbr_Tbp", "Ty"),
        15: ("Tbr_Tbp", "Tz"),
        22: ("Tbp_Tby", "Rx"),
        25: ("Tby_TCP", "Tx"),
    }
    assert {i: (parameter(i).frame, parameter(i).axis) for i in named} == named


@pytest.mark.parametrize("index", range(1, 31))
def test_the_engines_column_is_the_derivative_of_the_exact_kinematics(index: int) -> None:
    step = np.zeros(PARAMETERS)
    step[index - 1] = 1e-6
    difference = (tooling_ball_position(POSES, step, BALL) - tooling_ball_position(POSES, -step, BALL)) / 2e-6
    column = thesis_columns(JOINT, POSES)[:, index - 1].reshape(-1, 3)
    np.testing.assert_allclose(column, difference, atol=1e-9)


def test_a_payload_turns_the_joints_by_the_slope_of_its_potential() -> None:
    payload = np.full(len(POSES), 1.5)
    loads = JOINT.loads(POSES, payload)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        rise = [tooling_ball_position(POSES + s * step, np.zeros(PARAMETERS), BALL)[:, 2] for s in (1, -1)]
        torque = -1.5 * GRAVITY * (rise[0] - rise[1]) / 2e-6
        np.testing.assert_allclose(loads[f"torque_J{k + 1}"], torque, atol=1e-8)
    assert JOINT.loads(POSES, np.zeros(len(POSES))) == {}


def test_it_is_loaded_by_name_with_no_joint_measured() -> None:
    joint = load_mechanism("spherical-joint")
    assert [(j.name, j.measured) for j in joint.joints] == [("J1", False), ("J2", False), ("J3", False)]
    assert joint.slots == JOINT.slots


def test_impossible_joints_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="radius 0"):
        replace(JOINT, tooling_ball=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="no frame named 'flange'"):
        load_mechanism("spherical-joint", frame="flange")
    with pytest.raises(InputError, match="expected \\(poses, 3\\)"):
        JOINT.transforms(np.zeros((4, 2)))
