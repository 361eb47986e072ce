"""Preload limits: the thesis' figures, closed forms and force balance."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from joints.preload import (
    MagnetRing,
    ball_fixed_limit,
    cap_area,
    contact_directions,
    contact_forces,
    projected_area,
    published_socket_area,
    socket_fixed_limit,
    three_contact_limit,
    total_preload,
)

DEG = np.pi / 180
ANGLES = np.linspace(0, 90, 91) * DEG
CONTACT = 52.5 * DEG

# Tables 3.1 and 4.1: socket [deg], preload [N], ring [deg], count, area ratio [%], pressure [psi], [atm]
TABLE_3_1 = [
    (72, 83.70, 54, 8, 29.4, 3.5, 0.2),
    (54, 86.40, 36, 6, 29.4, 4.8, 0.3),
    (63, 86.40, 36, 6, 25.2, 4.2, 0.3),
    (72, 86.40, 36, 6, 22.0, 3.6, 0.2),
    (72, 100.69, 45, 8, 29.4, 4.2, 0.3),
    (63, 100.69, 45, 8, 33.6, 4.8, 0.3),
]


@pytest.mark.parametrize(("socket", "preload", "ring", "count", "ratio", "psi", "atm"), TABLE_3_1)
def test_preload_tables_to_the_printed_digit(
    socket: float, preload: float, ring: float, count: int, ratio: float, psi: float, atm: float
) -> None:
    magnets = MagnetRing(count, 17.80, ring * DEG, 12.7e-3)
    area = published_socket_area(26.194e-3, socket * DEG)
    assert round(total_preload([magnets]), 2) == preload
    assert round(float(100 * magnets.face_area / area), 1) == ratio
    assert round(float(magnets.axial_force / area / 6894.757), 1) == psi
    assert round(float(magnets.axial_force / area / 101325), 1) == atm


def test_published_area_is_a_cap_only_at_the_hemisphere() -> None:
    assert published_socket_area(1.0, np.pi / 2) == pytest.approx(float(cap_area(1.0, np.pi / 2)))
    assert published_socket_area(26.194e-3, 63 * DEG) / cap_area(26.194e-3, 63 * DEG) == pytest.approx(1.282, abs=5e-4)


def test_projected_area_is_the_integral_of_the_cap_along_the_axis() -> None:
    t = np.linspace(0, 70 * DEG, 20001)
    assert projected_area(2.0, 70 * DEG) == pytest.approx(
        np.trapezoid(2 * np.pi * 4 * np.sin(t) * np.cos(t), t), rel=1e-7
    )


def test_ball_fixed_limit_is_the_preload_everywhere() -> None:
    assert np.array_equal(ball_fixed_limit(100.7, ANGLES), np.full(91, 100.7))


def test_socket_fixed_limit_halves_for_a_reaction_at_30_degrees() -> None:
    limit = socket_fixed_limit(1.0, ANGLES, 30 * DEG)
    assert limit[0] == 1.0
    assert limit.min() == pytest.approx(0.5, abs=1e-12)
    assert ANGLES[limit.argmin()] == pytest.approx(60 * DEG)


@pytest.mark.parametrize("angle", [5, 40, 60, 90])
def test_socket_fixed_limit_balances_the_forces_of_figure_3_6(angle: float) -> None:
    theta, phi = angle * DEG, 25 * DEG
    pull = float(socket_fixed_limit(80.0, theta, phi))
    reaction = pull * np.sin(theta) / np.sin(phi)
    assert pull * np.cos(theta) - 80.0 + reaction * np.cos(phi) == pytest.approx(0, abs=1e-12)


def test_three_supports_fall_by_a_fifth_towards_one_and_gain_beyond_75_degrees() -> None:
    towards = three_contact_limit(1.0, ANGLES, 0.0, CONTACT)
    assert towards.min() == pytest.approx(np.sin(CONTACT), abs=1e-4)
    assert round(float(towards.min()), 1) == 0.8
    assert float(three_contact_limit(1.0, 75 * DEG, 0.0, CONTACT)) == pytest.approx(1.0, abs=1e-3)
    assert (towards[ANGLES > 76 * DEG] > 1).all()


def test_worst_azimuth_falls_to_0_546() -> None:
    limits = three_contact_limit(1.0, ANGLES[:, None], np.arange(360) * DEG, CONTACT)
    closed = 1 / (np.cos(ANGLES) + 2 * np.sin(ANGLES) / np.tan(CONTACT))
    assert limits.min(axis=1) == pytest.approx(closed, rel=1e-12)
    assert round(float(limits.min()), 3) == 0.546


@pytest.mark.parametrize("seed", range(5))
def test_three_contact_limit_is_where_the_first_support_unloads(seed: int) -> None:
    random = np.random.default_rng(seed)
    angle, azimuth, contact = random.uniform(0.1, 1.5), random.uniform(0, 2 * np.pi), random.uniform(0.3, 1.2)
    directions = contact_directions(contact)
    pull = float(three_contact_limit(50.0, angle, azimuth, contact))
    forces = contact_forces(50.0, pull, angle, azimuth, directions)
    applied = pull * np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    assert forces @ directions == pytest.approx(applied - [0, 0, 50.0], abs=1e-9)
    assert forces.min() == pytest.approx(0, abs=1e-9)


def test_supports_share_the_preload_at_rest() -> None:
    forces = contact_forces(100.0, 0.0, 0.0, 0.0, contact_directions(45 * DEG))
    assert forces == pytest.approx(np.full(3, 100 / (3 * np.cos(45 * DEG))))


def test_rings_add_up_to_the_rolling_joints_50_newtons() -> None:
    rings = [MagnetRing(6, 4.29, 45 * DEG, 6.35e-3), MagnetRing(8, 4.29, 22 * DEG, 6.35e-3)]
    assert round(total_preload(rings)) == 50


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: published_socket_area(0.025, 91 * DEG), "socket angle [deg] = 91, expected above 0 and at most 90"),
        (lambda: cap_area(-0.025, 1.0), "socket radius = -0.025, expected above 0 m"),
        (lambda: socket_fixed_limit(100, 1.0, 0.0), "reaction angle [deg] = 0"),
        (lambda: socket_fixed_limit(-1, 1.0, 1.0), "preload = -1, expected at least 0 N"),
        (lambda: ball_fixed_limit(1, 95 * DEG), "pull angle [deg] = 95, expected 0 to 90 deg"),
        (lambda: contact_directions(91 * DEG), "contact angle [deg] = 91, expected above 0 and at most 90"),
        (lambda: MagnetRing(0, 1.0, 1.0, 0.01), "magnet count = 0"),
        (lambda: MagnetRing(2, 1.0, np.nan, 0.01), "magnet ring angle [deg] = nan"),
    ],
)
def test_impossible_input_is_refused_in_one_line(call: object, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        call()  # type: ignore[operator]
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)
