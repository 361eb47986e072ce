"""Dry friction and magnet hysteresis against an integration in time that shares no formula with them."""

import numpy as np
import pytest
from damper_cases import SpringMassDamper
from scipy.integrate import solve_ivp

from gpmodel.errors import InputError
from joints.dynamics import receptance
from joints.friction import Losses, amplitude, energy_per_cycle, magnet_stiffness
from joints.stiffness import magnet_force

SYSTEM = SpringMassDamper(0.54, 900.0, 4.6e6)
FORCE = 100.0


def integrated_amplitude(friction: float, frequency: float) -> float:
    """Largest motion of the steady state; the sign of the speed is a steep tanh."""
    omega = 2 * np.pi * frequency

    def slope(time: float, state: np.ndarray) -> list[float]:
        x, v = state
        dry = friction * np.tanh(v / 1e-6)
        return [v, (FORCE * np.sin(omega * time) - SYSTEM.damping * v - SYSTEM.stiffness * x - dry) / SYSTEM.mass]

    end = 12 / frequency
    times = np.linspace(0.8 * end, end, 2000)
    return float(np.abs(solve_ivp(slope, (0, end), [0, 0], "LSODA", times, rtol=1e-7, atol=1e-12).y[0]).max())


def test_without_losses_it_is_the_receptance() -> None:
    f = np.geomspace(1.0, 2000.0, 50)
    np.testing.assert_allclose(amplitude(SYSTEM, Losses(0.0), FORCE, f), FORCE * np.abs(receptance(SYSTEM, f)))


@pytest.mark.parametrize("share", [0.1, 0.3])
@pytest.mark.parametrize("frequency", [200.0, 465.0, 900.0])
def test_friction_leaves_what_integration_leaves(share: float, frequency: float) -> None:
    """Harmonic balance is a first-harmonic answer: within 5 % where friction is a third of the force at most."""
    found = float(amplitude(SYSTEM, Losses(share * FORCE), FORCE, frequency))
    assert found == pytest.approx(integrated_amplitude(share * FORCE, frequency), rel=0.05)
    assert found < FORCE * abs(receptance(SYSTEM, frequency))


def test_what_the_force_puts_in_is_what_the_losses_take_out() -> None:
    losses, frequency = Losses(12.0, magnet_stiffness(100.69, 0.794e-3), 0.05), 300.0
    x = float(amplitude(SYSTEM, losses, FORCE, frequency))
    lost = {k: float(v) for k, v in energy_per_cycle(SYSTEM, losses, x, frequency).items()}
    omega = 2 * np.pi * frequency
    elastic = (SYSTEM.stiffness + losses.magnet_stiffness - SYSTEM.mass * omega**2) * x
    put_in = np.pi * x * np.sqrt(FORCE**2 - elastic**2)
    assert sum(lost.values()) == pytest.approx(put_in, rel=1e-9)
    assert all(part > 0 for part in lost.values())


def test_hysteresis_of_the_magnets_loses_the_same_at_any_frequency() -> None:
    losses = Losses(0.0, -2.5e5, 0.05)
    slow, fast = (energy_per_cycle(SYSTEM, losses, 1e-6, f) for f in (1.0, 100.0))
    assert slow["magnets"] == fast["magnets"]
    assert fast["film"] == pytest.approx(100 * slow["film"])


def test_friction_holds_the_joint_below_its_break_away_force() -> None:
    losses = Losses(50.0)
    forces = losses.break_away * np.array([0.5, 0.999, 1.001, 2.0])
    moved = amplitude(SYSTEM, losses, forces, 1.0)
    assert moved[0] == moved[1] == 0.0
    assert 0.0 < moved[2] < moved[3]


def test_magnet_stiffness_is_the_slope_of_the_pull() -> None:

    step = np.array([0.0, 1e-9])
    slope = np.diff(magnet_force(step, 100.69, 0.794e-3))[0] / 1e-9
    assert magnet_stiffness(100.69, 0.794e-3) == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize(("friction", "pull", "loss"), [(-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -0.1)])
def test_losses_that_would_add_energy_are_refused(friction: float, pull: float, loss: float) -> None:
    with pytest.raises(InputError, match="expected at least 0"):
        Losses(friction, pull, loss)
