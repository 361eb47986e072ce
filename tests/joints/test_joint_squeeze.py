"""Squeeze film: closed-form limits and the slow and fast ends of the compressible film."""

import numpy as np
import pytest

from joints.film import FilmGeometry
from joints.orifice import ATMOSPHERE
from joints.squeeze import squeeze_damping, squeeze_impedance, squeeze_number

JOINT = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)


def test_shallow_cap_damps_like_a_disc() -> None:
    shallow = FilmGeometry(1.0, 0.01, 0.003, 10e-6)
    disc = 3 * np.pi * shallow.viscosity * 0.01**4 / (2 * (20e-6) ** 3)
    assert float(squeeze_damping(shallow, 20e-6)) == pytest.approx(disc, rel=1e-3)


def test_concentric_hemisphere_has_its_closed_damping() -> None:
    """6 pi mu r^4 / h^3 times the integral of sin^3, 2/3."""
    hemisphere = FilmGeometry(0.02, np.pi / 2, 0.3, 15e-6)
    expected = 4 * np.pi * hemisphere.viscosity * 0.02**4 / (15e-6) ** 3
    assert float(squeeze_damping(hemisphere, 15e-6)) == pytest.approx(expected, rel=1e-12)


def test_slow_motion_is_damped_as_if_incompressible() -> None:
    slow = squeeze_impedance(JOINT, 50e-6, 0.1)
    assert float(slow.imag) / (2 * np.pi * 0.1) == pytest.approx(float(squeeze_damping(JOINT, 50e-6)), rel=1e-4)
    assert abs(float(slow.real)) < 1e-2 * abs(float(slow.imag))


def test_fast_motion_traps_the_air() -> None:
    """The spring p_a times the integral of cos^2 / h over the cap; the edge leaks, less and less."""
    alpha = JOINT.socket_angle
    t = np.linspace(0, alpha, 20001)
    h = JOINT.clearance + (50e-6 - JOINT.clearance) * np.cos(t)
    trapped = np.trapezoid(ATMOSPHERE * np.cos(t) ** 2 / h * 2 * np.pi * JOINT.ball_radius**2 * np.sin(t), t)
    fast = squeeze_impedance(JOINT, 50e-6, np.array([1e4, 1e6]), cells=2000).real
    assert trapped > fast[1] > fast[0]
    assert fast[1] == pytest.approx(trapped, rel=0.01)


def test_damping_never_feeds_energy() -> None:
    impedance = squeeze_impedance(JOINT, 30e-6, np.geomspace(0.1, 1e5, 40))
    assert (impedance.imag > 0).all()
    assert (np.diff(impedance.real) > 0).all()


def test_finer_grids_change_nothing() -> None:
    f = np.array([1.0, 50.0, 500.0])
    assert squeeze_impedance(JOINT, 40e-6, f, 400) == pytest.approx(squeeze_impedance(JOINT, 40e-6, f, 1600), rel=2e-3)


def test_squeeze_number_grows_with_frequency() -> None:
    assert float(squeeze_number(JOINT, 50e-6, 100.0)) == pytest.approx(2 * float(squeeze_number(JOINT, 50e-6, 50.0)))
