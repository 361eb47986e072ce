"""Spring, mass and damper: textbook values, identification, and the trapped air."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from joints.dynamics import SpringMassDamper, ball_mass, film_receptance, fit_response

LIGHT = SpringMassDamper(0.5, 100.0, 4.5e6)
HEAVY = SpringMassDamper(2.0, 3000.0, 3.4e6)


def test_two_inch_steel_ball() -> None:
    assert ball_mass(25.4e-3, 7850.0) == pytest.approx(0.539, abs=5e-4)


@pytest.mark.parametrize("system", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_receptance_starts_at_the_compliance_and_lags_90_degrees_at_the_natural_frequency(
    system: SpringMassDamper,
) -> None:
    static, natural = system.receptance([0.0, system.natural_frequency])
    assert static == pytest.approx(1 / system.stiffness)
    assert np.angle(natural) == pytest.approx(-np.pi / 2)
    assert abs(natural) * system.stiffness == pytest.approx(1 / (2 * system.damping_ratio))


def test_resonance_is_the_peak_of_the_response() -> None:
    f = np.linspace(1, 1000, 200001)
    assert f[np.abs(LIGHT.receptance(f)).argmax()] == pytest.approx(LIGHT.resonance, abs=0.01)


@pytest.mark.parametrize("system", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_bandwidth_is_3_decibels_down(system: SpringMassDamper) -> None:
    assert abs(system.receptance(system.bandwidth)) * system.stiffness == pytest.approx(np.sqrt(0.5))


def test_an_overdamped_joint_has_no_resonance() -> None:
    assert SpringMassDamper(0.5, 2940.0, 3.4e6).resonance == 0.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("system", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_planted_systems_come_back_within_their_errors(system: SpringMassDamper, seed: int) -> None:
    random = np.random.default_rng(seed)
    f = np.geomspace(5, 1500, 150)
    ripple = random.normal(size=150) + 1j * random.normal(size=150)
    fit = fit_response(f, system.receptance(f) * (1 + 0.01 * ripple))
    for name in ("mass", "damping", "stiffness"):
        assert abs(getattr(fit.system, name) - getattr(system, name)) < 4 * fit.stderr[name]
        assert fit.stderr[name] < 0.05 * getattr(system, name)


def test_air_that_only_damps_makes_a_spring_mass_damper() -> None:
    f = np.geomspace(1, 500, 20)
    assert film_receptance(2.0, 3.4e6, 2j * np.pi * f * 3000.0, f) == pytest.approx(HEAVY.receptance(f))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: SpringMassDamper(0.0, 1.0, 1.0), "mass = 0, expected above 0 kg"),
        (lambda: SpringMassDamper(1.0, -1.0, 1.0), "damping = -1, expected at least 0 N s/m"),
        (lambda: fit_response([1.0, 2.0], [1e-6, 1e-6]), "2 frequencies and 2 values, expected 3 or more"),
        (lambda: fit_response([1.0, 2.0, 0.0], [1e-6] * 3), "frequency = 0, expected above 0 Hz"),
        (lambda: fit_response([1.0, 2.0, 3.0], [1e-6, 0.0, 1e-6]), "receptance = 0"),
        (lambda: fit_response([100.0, 200.0, 300.0], [-1e-6, -2e-6, -3e-6]), "expected above 0"),
        (lambda: LIGHT.receptance(-1.0), "frequency = -1"),
    ],
)
def test_impossible_input_is_refused(call: object, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        call()  # type: ignore[operator]
    assert words in str(refusal.value)
