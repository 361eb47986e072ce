"""Squeeze film: closed-form limits and the slow and fast ends of the compressible film."""

import numpy as np
import pytest

from joints.fed_film import squeeze_impedance, squeeze_number
from joints.film import FilmGeometry
from joints.orifice import ATMOSPHERE

JOINT = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)


def damping(geometry: FilmGeometry, displacement: float) -> float:
    """c = 6 pi mu r^4 integral from 0 to alpha of sin^3 t / h^3 dt [N s/m]: dp/dt = 6 mu v r^2 sin t / h^3."""
    t = np.linspace(0.0, geometry.socket_angle, 20001)
    gap = geometry.clearance + (displacement - geometry.clearance) * np.cos(t)
    return float(6 * np.pi * geometry.viscosity * geometry.ball_radius**4 * np.trapezoid(np.sin(t) ** 3 / gap**3, t))


SHALLOW = FilmGeometry(1.0, 0.01, 0.003, 10e-6)
HEMISPHERE = FilmGeometry(0.02, np.pi / 2, 0.3, 15e-6)


@pytest.mark.parametrize(
    ("geometry", "lift", "expected"),
    [
        pytest.param(SHALLOW, 20e-6, 3 * np.pi * SHALLOW.viscosity * 0.01**4 / (2 * (20e-6) ** 3), id="a disc"),
        pytest.param(HEMISPHERE, 15e-6, 4 * np.pi * HEMISPHERE.viscosity * 0.02**4 / (15e-6) ** 3, id="concentric"),
        pytest.param(JOINT, 50e-6, damping(JOINT, 50e-6), id="the thesis' joint"),
    ],
)
def test_slow_motion_is_damped_as_if_incompressible(geometry: FilmGeometry, lift: float, expected: float) -> None:
    slow = squeeze_impedance(geometry, lift, 0.1)
    assert float(slow.imag) / (2 * np.pi * 0.1) == pytest.approx(expected, rel=1e-3)
    assert abs(float(slow.real)) < 0.1 * abs(float(slow.imag))


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
