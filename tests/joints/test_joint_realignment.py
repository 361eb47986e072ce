"""Passive angles at least energy: closed cases, and a general optimiser where a bound holds."""

import numpy as np
import pytest
from scipy.optimize import minimize
from spherical_cases import JOINT

from gpmodel.errors import InputError
from joints.budget import ErrorSource, error_budget
from joints.kinematics import PARAMETERS, tooling_ball_position
from joints.realignment import IDLE, realigned

BALL = np.array(JOINT.tooling_ball)
ISOTROPIC = np.eye(3)


def drawn(seed: int, poses: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, errors of 0.1 mm and 1 mrad, and where the ball is held: where it would be without errors."""
    rng = np.random.default_rng(seed)
    q, errors = rng.uniform(-0.7, 0.7, (poses, 3)), 1e-4 * rng.normal(size=(poses, PARAMETERS))
    errors[:, [k for k in range(PARAMETERS) if k % 6 > 2]] *= 10.0
    return q, errors, tooling_ball_position(q, np.zeros(PARAMETERS), BALL)


def test_free_angles_leave_the_change_of_the_distance_from_the_centre() -> None:
    """Errors of the base, and of the lever: the ball can be anywhere on a sphere about the centre."""
    q, errors, held = drawn(1)
    errors[:, 6:24] = 0.0
    angles = realigned(q, errors, BALL, held, 1.0, ISOTROPIC)
    left = np.linalg.norm(tooling_ball_position(angles, errors, BALL) - held, axis=1)
    radius = np.linalg.norm(BALL + errors[:, 24:27], axis=1)
    np.testing.assert_allclose(left, np.abs(np.linalg.norm(held - errors[:, :3], axis=1) - radius), atol=1e-12)


def test_a_link_strains_by_nothing_but_its_own_length() -> None:
    """Stiff along one line alone, the ball is led to the plane across it, nanometres of idle angles aside."""
    q, errors, held = drawn(2)
    line = np.array([0.6, 0.0, 0.8])
    angles = realigned(q, errors, BALL, held, 1.0, 2e7 * np.outer(line, line))
    np.testing.assert_allclose((tooling_ball_position(angles, errors, BALL) - held) @ line, 0.0, atol=2e-9)


@pytest.mark.parametrize("reach", [0.0, 2e-4, 1e-3])
def test_within_a_range_no_other_angles_strain_less(reach: float) -> None:
    q, errors, held = drawn(3)
    stiffness = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.2], [0.0, 0.2, 0.5]])
    angles = realigned(q, errors, BALL, held, reach, stiffness)
    assert np.abs(angles - q).max() <= reach * (1 + 1e-12)

    def energy(pose: int, turned: np.ndarray) -> float:
        apart = 1e6 * (tooling_ball_position(q[pose] + turned, errors[pose], BALL) - held[pose])
        idle = 1e6 * IDLE * np.linalg.norm(BALL) * turned
        return float(apart @ stiffness @ apart / np.linalg.eigvalsh(stiffness)[-1] + idle @ idle)

    for pose in range(len(q)):
        best = minimize(lambda x, k=pose: energy(k, reach * x), np.zeros(3), bounds=[(-1, 1)] * 3, tol=1e-14)
        assert energy(pose, angles[pose] - q[pose]) <= best.fun * (1 + 1e-6) + 1e-9


@pytest.mark.long
def test_a_budget_after_realignment_has_the_radial_part_alone() -> None:
    """A shift of the shaft along x leaves |x / lever|, to first order; a turn of the socket leaves nothing."""
    for index, share in ((25, abs(BALL[0]) / np.linalg.norm(BALL)), (5, 0.0)):
        source = ErrorSource(index, 3e-5, "systematic", "normal", "test")
        whole = error_budget(JOINT, (source,), "systematic", np.random.default_rng(0), 40, 200)
        free, held = whole.realigned(0.1).worst_case, whole.worst_case
        assert free == pytest.approx(share * held, rel=2e-3, abs=1e-3 * held)


def test_a_range_is_no_negative_angle() -> None:
    q, errors, held = drawn(4)
    with pytest.raises(InputError, match="range of realignment = -1, expected at least 0 rad"):
        realigned(q, errors, BALL, held, -1.0, ISOTROPIC)
