"""Hertz contact: Table 3.3 as printed, and right against independent solutions."""

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from gpmodel.errors import InputError
from joints.contact import Body, contact_modulus, first_yield_pressure, hertz, published_hertz, relative_curvatures

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


def test_stress_ratio_as_printed() -> None:
    assert round(float(published_hertz(100.0, *PRINTED).pressure) / 2.25e8, 2) == 0.01


def test_two_balls_deform_by_4_5_micrometres_under_2_1_gigapascals() -> None:
    """Table 3.3's R_maj = 1e6 m makes cylinders of the balls; the thesis calls the 0.5 um it gives negligible."""
    right = hertz(100.0, BALL, SUPPORT)
    assert round(float(right.approach) * 1e6, 1) == 4.5
    assert round(float(right.pressure) * 1e-9, 1) == 2.1
    assert round(float(hertz(70.0, BALL, SUPPORT).approach) * 1e6, 1) == 3.6


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


def test_forces_are_vectorised() -> None:
    forces = np.array([[10.0, 20.0], [40.0, 80.0]])
    approach = hertz(forces, BALL, SUPPORT).approach
    assert approach.shape == (2, 2)
    assert approach[1, 1] / approach[0, 0] == pytest.approx(4.0)


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
