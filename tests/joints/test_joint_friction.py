"""Dry friction and magnet hysteresis against an integration in time that shares no formula with them."""

import numpy as np
import pytest
from damper_cases import SpringMassDamper

from gpmodel.errors import InputError
from joints.dynamics import receptance
from joints.friction import Losses, largest_motion, magnet_stiffness, steady_state
from joints.stiffness import magnet_force

SYSTEM = SpringMassDamper(0.54, 900.0, 4.6e6)
FORCE = 100.0
STEPS = 2000


def integrated_amplitude(friction: float, frequency: float, cycles: int) -> float:
    """Largest motion of the last cycle, by implicit time steps in which friction holds or slips."""
    step = 1.0 / (frequency * STEPS)
    force = (FORCE * np.sin(2 * np.pi * np.arange(1, STEPS + 1) / STEPS)).tolist()
    resists = SYSTEM.mass / step + SYSTEM.damping + SYSTEM.stiffness * step
    x, v, largest = 0.0, 0.0, 0.0
    for _ in range(cycles):
        largest = 0.0
        for f in force:
            push = SYSTEM.mass * v / step - SYSTEM.stiffness * x + f
            v = np.sign(push) * max(abs(push) - friction, 0.0) / resists
            x += step * v
            largest = max(largest, abs(x))
    return largest


def test_without_friction_it_is_the_receptance() -> None:
    f = np.geomspace(1.0, 2000.0, 50)
    found = [steady_state(SYSTEM, Losses(0.0), FORCE, one).amplitude for one in f]
    np.testing.assert_allclose(found, FORCE * np.abs(receptance(SYSTEM, f)))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize(
    ("frequency", "cycles"),
    [
        (1.0, 2),
        (200.0, 12),
        *(pytest.param(f, n, marks=pytest.mark.long) for f, n in ((50.0, 3), (465.0, 40), (900.0, 40))),
    ],
)
def test_friction_leaves_what_integration_leaves(share: float, frequency: float, cycles: int) -> None:
    found = steady_state(SYSTEM, Losses(share * FORCE), FORCE, frequency).amplitude
    assert found == pytest.approx(integrated_amplitude(share * FORCE, frequency, cycles), rel=0.015)
    assert found < FORCE * abs(receptance(SYSTEM, frequency))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_slow_motion_is_the_play_of_a_spring_with_friction(share: float) -> None:
    """(F - F_c) / k, and the area 4 F_c X of its loop."""
    state, motion = steady_state(SYSTEM, Losses(share * FORCE), FORCE, 0.1), (1.0 - share) * FORCE / SYSTEM.stiffness
    assert state.amplitude == pytest.approx(motion, rel=0.01)
    assert state.friction == pytest.approx(4.0 * share * FORCE * motion, rel=0.01)


@pytest.mark.parametrize("frequency", [1.0, 300.0])
def test_what_the_force_puts_in_is_what_the_losses_take_out(frequency: float) -> None:
    losses = Losses(12.0, magnet_stiffness(100.69, 0.794e-3), 0.05)
    state = steady_state(SYSTEM, losses, FORCE, frequency)
    wave = np.exp(-1j * np.pi * np.arange(len(state.motion)) / len(state.motion))
    lag = 2.0 * np.mean(state.motion * wave).real
    assert state.lost == pytest.approx(-np.pi * FORCE * lag, rel=1e-6)
    assert min(state.film, state.friction, state.magnets) > 0.0


def test_hysteresis_of_the_magnets_loses_the_same_at_any_frequency() -> None:
    losses = Losses(0.0, -2.5e5, 0.05)
    slow, fast = (steady_state(SYSTEM, losses, FORCE, f) for f in (1.0, 10.0))
    each = [state.magnets / state.amplitude**2 for state in (slow, fast)]
    assert each[0] == pytest.approx(each[1])
    assert fast.film / fast.amplitude**2 == pytest.approx(10 * slow.film / slow.amplitude**2)


@pytest.mark.parametrize(("share", "moves"), [(0.5, False), (0.999, False), (1.02, True), (2.0, True)])
def test_friction_holds_the_joint_under_less_than_itself(share: float, moves: bool) -> None:
    assert (steady_state(SYSTEM, Losses(FORCE / share), FORCE, 1.0).amplitude > 1e-9) == moves


@pytest.mark.parametrize("friction", [0.0, pytest.param(30.0, marks=pytest.mark.long)])
def test_the_largest_motion_is_at_the_peak_between_two_frequencies(friction: float) -> None:
    f = np.array([100.0, 250.0, 700.0, 1000.0])
    found = largest_motion(SYSTEM, Losses(friction), FORCE, f)
    fine = [steady_state(SYSTEM, Losses(friction), FORCE, one, 64).amplitude for one in np.linspace(300.0, 500.0, 41)]
    assert found == pytest.approx(max(fine), rel=0.01)


def test_magnet_stiffness_is_the_slope_of_the_pull() -> None:
    step = np.array([0.0, 1e-9])
    slope = np.diff(magnet_force(step, 100.69, 0.794e-3))[0] / 1e-9
    assert magnet_stiffness(100.69, 0.794e-3) == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize(("friction", "pull", "loss"), [(-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -0.1)])
def test_losses_that_would_add_energy_are_refused(friction: float, pull: float, loss: float) -> None:
    with pytest.raises(InputError, match="expected at least 0"):
        Losses(friction, pull, loss)
