"""The ball on its film: textbook values of a plain damper, the film by a quadrature of its own, identification."""

import numpy as np
import pytest
from damper_cases import SpringMassDamper
from scipy.special import eval_legendre, roots_legendre

from gpmodel.errors import InputError
from joints.dynamics import (
    ball_mass,
    ball_on_constant_feed,
    bandwidth,
    fit_response,
    natural_frequency,
    receptance,
    resonance,
)
from joints.film import FilmGeometry
from joints.orifice import ATMOSPHERE

LIGHT = SpringMassDamper(0.5, 100.0, 4.5e6)
HEAVY = SpringMassDamper(2.0, 3000.0, 3.4e6)
JOINT = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)
LIFT = 50e-6


def test_two_inch_steel_ball() -> None:
    assert ball_mass(25.4e-3, 7850.0) == pytest.approx(0.539, abs=5e-4)


@pytest.mark.parametrize("system", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_receptance_starts_at_the_compliance_and_lags_90_degrees_at_the_natural_frequency(
    system: SpringMassDamper,
) -> None:
    static, natural = receptance(system, [0.0, natural_frequency(system)])
    assert static == pytest.approx(1 / system.stiffness)
    assert np.angle(natural) == pytest.approx(-np.pi / 2)
    assert abs(natural) * system.stiffness == pytest.approx(1 / (2 * system.damping_ratio))


def test_the_peak_of_a_plain_damper_is_the_textbooks() -> None:
    zeta = LIGHT.damping_ratio
    found, times = resonance(LIGHT)
    assert found == pytest.approx(natural_frequency(LIGHT) * np.sqrt(1 - 2 * zeta**2), rel=1e-5)
    assert times == pytest.approx(1 / (2 * zeta * np.sqrt(1 - zeta**2)), rel=1e-8)


@pytest.mark.parametrize("system", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_bandwidth_is_3_decibels_down(system: SpringMassDamper) -> None:
    middle = 1 - 2 * system.damping_ratio**2
    known = natural_frequency(system) * np.sqrt(middle + np.sqrt(middle**2 + 1))
    assert bandwidth(system) == pytest.approx(known, rel=1e-9)


def test_an_overdamped_joint_has_no_resonance() -> None:
    assert resonance(SpringMassDamper(0.5, 2940.0, 3.4e6)) == (0.0, 1.0)


def galerkin(frequency: float, order: int = 60) -> complex:
    """Complex stiffness of the squeezed air by polynomials in the angle squared that vanish at the edge: the weak form
    of the linearised Reynolds equation, which shares no formula with the finite volumes."""
    alpha, r = JOINT.socket_angle, JOINT.ball_radius
    nodes, weights = roots_legendre(400)
    t, w = alpha * (nodes + 1) / 2, weights * alpha / 2
    gap = JOINT.clearance + (LIFT - JOINT.clearance) * np.cos(t)
    s = t / alpha
    shapes = np.array([(1 - s**2) * eval_legendre(k, 2 * s**2 - 1) for k in range(order)])
    fine = np.array([np.gradient(shape, t, edge_order=2) for shape in shapes])
    rate = 12 * JOINT.viscosity * r**2 / ATMOSPHERE * 2j * np.pi * frequency
    system = (fine * np.sin(t) * gap**3 * w) @ fine.T + rate * (shapes * gap * np.sin(t) * w) @ shapes.T
    load = -rate * ATMOSPHERE * (shapes * np.cos(t) * np.sin(t) * w).sum(axis=1)
    pressure = np.linalg.solve(system, load) @ shapes
    return complex(-2 * np.pi * r**2 * (pressure * np.cos(t) * np.sin(t) * w).sum())


@pytest.mark.parametrize(
    ("stiffness", "peak", "times", "band"),
    [(3.42e6, 554.0, 3.4, 731.0), (4.59e6, 603.0, 4.8, 818.0)],
    ids=["flat", "sphere"],
)
def test_compressed_air_leaves_the_ball_a_resonance(stiffness: float, peak: float, times: float, band: float) -> None:
    ball = ball_on_constant_feed(ball_mass(25.4e-3, 7850.0), stiffness, JOINT, LIFT)
    found, larger = resonance(ball)
    assert found == pytest.approx(peak, rel=0.03)
    assert larger == pytest.approx(times, rel=0.03)
    assert bandwidth(ball) == pytest.approx(band, rel=0.03)
    for frequency in (found, bandwidth(ball)):
        omega = 2 * np.pi * frequency
        own = ball.stiffness - ball.mass * omega**2 + galerkin(frequency)
        assert own == pytest.approx(complex(ball.dynamic_stiffness(frequency)), rel=0.03)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("system", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_planted_systems_come_back_within_their_errors(system: SpringMassDamper, seed: int) -> None:
    random = np.random.default_rng(seed)
    f = np.geomspace(5, 1500, 150)
    ripple = random.normal(size=150) + 1j * random.normal(size=150)
    fit = fit_response(f, receptance(system, f) * (1 + 0.01 * ripple), 2j * np.pi * f)
    found = {"mass": fit.mass, "resistance": fit.resistance, "stiffness": fit.stiffness}
    truth = {"mass": system.mass, "resistance": system.damping, "stiffness": system.stiffness}
    for name, value in truth.items():
        assert abs(found[name] - value) < 4 * fit.stderr[name]
        assert fit.stderr[name] < 0.05 * value


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ball_on_constant_feed(0.0, 1.0, JOINT, LIFT), "mass = 0, expected above 0 kg"),
        (
            lambda: ball_on_constant_feed(1.0, 1.0, JOINT, LIFT, -1.0),
            "share of the squeezed air = -1, expected at least 0",
        ),
        (lambda: fit_response([1.0, 2.0], [1e-6, 1e-6], [1j, 2j]), "2 frequencies and 2 values, expected 3 or more"),
        (lambda: fit_response([1.0, 2.0, 0.0], [1e-6] * 3, [1j] * 3), "frequency = 0, expected above 0 Hz"),
        (lambda: fit_response([1.0, 2.0, 3.0], [1e-6, 0.0, 1e-6], [1j] * 3), "receptance = 0"),
        (lambda: fit_response([100.0, 200.0, 300.0], [-1e-6, -2e-6, -3e-6], [1j] * 3), "expected above 0"),
        (lambda: ball_on_constant_feed(1.0, 1.0, JOINT, LIFT).dynamic_stiffness(-1.0), "frequency = -1"),
    ],
)
def test_impossible_input_is_refused(call: object, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        call()  # type: ignore[operator]
    assert words in str(refusal.value)
