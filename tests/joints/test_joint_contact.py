"""Test Hertz contact: Table 3.3 as printed, and the correct value against independent solutions."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import ellipe, ellipk
from spherical_cases import JOINT

from gpmodel.errors import InputError
from joints.budget import IDLE, ErrorSource, error_budget, realigned
from joints.contact import Body, contact_modulus, first_yield_pressure, hertz, published_hertz, relative_curvatures
from joints.passive_joint import PARAMETERS, tooling_ball_position

STEEL = 2e11
BALL, SUPPORT = Body(25.4e-3, 25.4e-3, STEEL), Body(6.3e-3, 6.3e-3, STEEL)
PRINTED = Body(1e6, 25.4e-3, STEEL), Body(1e6, 6.3e-3, STEEL)


@pytest.mark.parametrize(
    ("field", "scale", "digits", "printed"),
    [
        ("equivalent_radius", 1, 5, 0.00505),
        ("cos_theta", 1, 4, 1.0),
        ("theta", 1e4, 2, 2.01),
        ("alpha", 1, 2, 3601.73),
        ("beta", 1, 4, 0.1702),
        ("lam", 1, 4, 0.1053),
        ("semi_major", 1, 4, 0.6854),
        ("semi_minor", 1e5, 3, 3.238),
        ("pressure", 1e-6, 3, 2.151),
        ("approach", 1e6, 4, 0.5037),
        ("stiffness", 1e-6, 1, 198.5),
    ],
)
def test_table_3_3_as_printed(field: str, scale: float, digits: int, printed: float) -> None:
    assert round(float(getattr(published_hertz(100.0, *PRINTED), field)) * scale, digits) == printed


def test_balls_follow_the_closed_form() -> None:
    radius, modulus = 1 / (1 / 25.4e-3 + 1 / 6.3e-3), contact_modulus(BALL, SUPPORT)
    right = hertz(100.0, BALL, SUPPORT)
    assert float(right.approach) == pytest.approx((9 * 100.0**2 / (16 * radius * modulus**2)) ** (1 / 3), rel=1e-10)
    assert float(right.semi_major) == pytest.approx((3 * 100.0 * radius / (4 * modulus)) ** (1 / 3), rel=1e-10)
    assert float(right.semi_minor) == pytest.approx(float(right.semi_major), rel=1e-10)


@pytest.mark.parametrize("ratio", [1.001, 1.5, 4.0, 30.0, 1e4])
def test_ellipses_satisfy_hertz_equations(ratio: float) -> None:
    one, two = Body(0.02 * ratio, 0.02, 2e11), Body(np.inf, np.inf, 1e11, 0.25)
    contact, modulus = hertz(50.0, one, two), contact_modulus(one, two)
    a, b, p = float(contact.semi_major), float(contact.semi_minor), float(contact.pressure)
    m = 1 - (b / a) ** 2
    assert p * b / modulus * ellipk(m) == pytest.approx(float(contact.approach), rel=1e-9)
    assert p * b / (modulus * m * a**2) * (ellipk(m) - ellipe(m)) == pytest.approx(0.5 / (0.02 * ratio), rel=1e-6)
    assert p * b / (modulus * m * a**2) * (ellipe(m) / (1 - m) - ellipk(m)) == pytest.approx(0.5 / 0.02, rel=1e-6)
    assert 2 / 3 * np.pi * a * b * p == pytest.approx(50.0, rel=1e-12)


@pytest.mark.parametrize("ratio", [1.0, 2.0, 5.0])
def test_slocums_fits_agree_with_the_exact_contact_for_true_radii(ratio: float) -> None:
    one = Body(0.02 * ratio, 0.02, STEEL)
    fitted, right = published_hertz(80.0, one, SUPPORT), hertz(80.0, one, SUPPORT)
    assert float(fitted.approach) == pytest.approx(float(right.approach), rel=0.01)
    assert float(fitted.pressure) == pytest.approx(float(right.pressure), rel=0.03)


def test_crossed_equal_cylinders_are_a_ball_on_a_flat() -> None:
    cylinder = Body(np.inf, 0.01, STEEL)
    assert relative_curvatures(cylinder, cylinder, np.pi / 2) == pytest.approx((50.0, 50.0))
    ball, flat = Body(0.01, 0.01, STEEL), Body(np.inf, np.inf, STEEL)
    crossed = hertz(10.0, cylinder, cylinder, np.pi / 2)
    assert float(crossed.approach) == pytest.approx(float(hertz(10.0, ball, flat).approach), rel=1e-9)


def test_stiffness_is_the_slope_of_force_over_approach() -> None:
    low, high = hertz(100 - 1e-3, BALL, SUPPORT), hertz(100 + 1e-3, BALL, SUPPORT)
    slope = 2e-3 / float(high.approach - low.approach)
    assert float(hertz(100.0, BALL, SUPPORT).stiffness) == pytest.approx(slope, rel=1e-6)


def test_first_yield_is_at_1_61_yield_stresses() -> None:
    """Johnson 1985, section 6.1: p0 = 1.60 Y for nu = 0.3."""
    assert float(first_yield_pressure(1.0, 0.3)) == pytest.approx(1.61, abs=0.01)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Body(0.0, 1.0, STEEL), "major radius = 0"),
        (lambda: Body(1.0, 1.0, -1.0), "elastic modulus = -1, expected above 0 Pa"),
        (lambda: Body(1.0, 1.0, STEEL, 0.6), "Poisson's ratio = 0.6"),
        (lambda: hertz(-5.0, BALL, SUPPORT), "contact force = -5, expected above 0 N"),
        (
            lambda: hertz(5.0, Body(np.inf, 1.0, STEEL), Body(np.inf, 1.0, STEEL)),
            "expected above 0 1/m: a point contact",
        ),
        (lambda: hertz(5.0, BALL, Body(-0.02, -0.02, STEEL)), "smallest relative curvature"),
    ],
)
def test_impossible_contacts_are_refused(call: object, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        call()  # type: ignore[operator]
    assert words in str(refusal.value)


BALL_REALIGNMENT = np.array(JOINT.tooling_ball)
ISOTROPIC = np.eye(3)


def drawn(seed: int, poses: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, errors of 0.1 mm and 1 mrad, and where the ball is held: where it would be without errors."""
    rng = np.random.default_rng(seed)
    q, errors = rng.uniform(-0.7, 0.7, (poses, 3)), 1e-4 * rng.normal(size=(poses, PARAMETERS))
    errors[:, [k for k in range(PARAMETERS) if k % 6 > 2]] *= 10.0
    return q, errors, tooling_ball_position(q, np.zeros(PARAMETERS), BALL_REALIGNMENT)


def test_free_angles_leave_the_change_of_the_distance_from_the_centre() -> None:
    """Errors of the base, and of the lever: the ball can be anywhere on a sphere about the centre."""
    q, errors, held = drawn(1)
    errors[:, 6:24] = 0.0
    angles = realigned(q, errors, BALL_REALIGNMENT, held, 1.0, ISOTROPIC)
    left = np.linalg.norm(tooling_ball_position(angles, errors, BALL_REALIGNMENT) - held, axis=1)
    radius = np.linalg.norm(BALL_REALIGNMENT + errors[:, 24:27], axis=1)
    np.testing.assert_allclose(left, np.abs(np.linalg.norm(held - errors[:, :3], axis=1) - radius), atol=1e-12)


def test_a_link_strains_by_nothing_but_its_own_length() -> None:
    """Stiff along one line alone, the ball is led to the plane across it, nanometres of idle angles aside."""
    q, errors, held = drawn(2)
    line = np.array([0.6, 0.0, 0.8])
    angles = realigned(q, errors, BALL_REALIGNMENT, held, 1.0, 2e7 * np.outer(line, line))
    np.testing.assert_allclose((tooling_ball_position(angles, errors, BALL_REALIGNMENT) - held) @ line, 0.0, atol=2e-9)


@pytest.mark.parametrize("reach", [0.0, 2e-4, 1e-3])
def test_within_a_range_no_other_angles_strain_less(reach: float) -> None:
    q, errors, held = drawn(3)
    stiffness = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.2], [0.0, 0.2, 0.5]])
    angles = realigned(q, errors, BALL_REALIGNMENT, held, reach, stiffness)
    assert np.abs(angles - q).max() <= reach * (1 + 1e-12)

    def energy(pose: int, turned: np.ndarray) -> float:
        apart = 1e6 * (tooling_ball_position(q[pose] + turned, errors[pose], BALL_REALIGNMENT) - held[pose])
        idle = 1e6 * IDLE * np.linalg.norm(BALL_REALIGNMENT) * turned
        return float(apart @ stiffness @ apart / np.linalg.eigvalsh(stiffness)[-1] + idle @ idle)

    for pose in range(len(q)):
        best = minimize(lambda x, k=pose: energy(k, reach * x), np.zeros(3), bounds=[(-1, 1)] * 3, tol=1e-14)
        assert energy(pose, angles[pose] - q[pose]) <= best.fun * (1 + 1e-6) + 1e-9


@pytest.mark.long
def test_a_budget_after_realignment_has_the_radial_part_alone() -> None:
    """A shift of the shaft along x leaves |x / lever|, to first order; a turn of the socket leaves nothing."""
    for index, share in ((25, abs(BALL_REALIGNMENT[0]) / np.linalg.norm(BALL_REALIGNMENT)), (5, 0.0)):
        source = ErrorSource(index, 3e-5, "systematic", "normal", "test")
        whole = error_budget(JOINT, (source,), "systematic", np.random.default_rng(0), 40, 200)
        free, held = whole.realigned(0.1).worst_case, whole.worst_case
        assert free == pytest.approx(share * held, rel=2e-3, abs=1e-3 * held)


def test_a_range_is_no_negative_angle() -> None:
    q, errors, held = drawn(4)
    with pytest.raises(InputError, match="range of realignment = -1, expected at least 0 rad"):
        realigned(q, errors, BALL_REALIGNMENT, held, -1.0, ISOTROPIC)
