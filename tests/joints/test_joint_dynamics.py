"""Test the dynamics of the ball: a plain damper, a fed film, dry friction."""

from collections.abc import Callable

import numpy as np
import pytest
from damper_cases import SpringMassDamper
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import eval_legendre, roots_legendre

from gpmodel.errors import InputError
from joints.dynamics import (
    Losses,
    ball_mass,
    ball_on_constant_feed,
    bandwidth,
    fit_response,
    largest_motion,
    magnet_stiffness,
    natural_frequency,
    receptance,
    resonance,
    steady_state,
)
from joints.film import FilmGeometry
from joints.orifice import ATMOSPHERE, LinearOrifice, NozzleOrifice, Orifice
from joints.reynolds import FedFilm, compressible_film, decay_per_cycle, fed_film
from joints.stiffness import magnet_force

LIGHT = SpringMassDamper(0.5, 100.0, 4.5e6)
HEAVY = SpringMassDamper(2.0, 3000.0, 3.4e6)
JOINT = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)
LIFT = 50e-6


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
        (
            lambda: fit_response([1.0, 2.0], [1e-6, 1e-6], [1j, 2j]),
            "2 frequencies and 2 values, expected equal numbers, at least 3",
        ),
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


LOAD, LIFT_FILM, MASS, MAGNETS = 100.69, 50e-6, 0.539, -0.2536e6
LAWS = {"linear": LinearOrifice(), "nozzle": NozzleOrifice(150e-6)}


def film(law: str = "linear", lift: float = LIFT_FILM) -> FedFilm:
    return fed_film(JOINT, LOAD, LAWS[law], lift)


def inlet_of(orifice: Orifice, lift: float) -> float:
    flow, socket = compressible_film(JOINT, LOAD, lift)
    return float(orifice.inlet_pressure(flow, socket))


def integrated(orifice: Orifice, pocket: float, cells: int = 60) -> complex:
    """s of x ~ exp(s tau): Reynolds' equation and Newton's, not linearised, in s = ln tan(t/2) beyond the ring and one
    chamber within it, from rest 10 nm too high; the growth and the period of what follows."""
    inlet, r = inlet_of(orifice, LIFT_FILM), JOINT.ball_radius
    edge = np.linspace(*np.log(np.tan(np.array([JOINT.orifice_angle, JOINT.socket_angle]) / 2)), cells + 1)
    middle = (edge[1:] + edge[:-1]) / 2
    face = 2 * np.arctan(np.exp(edge))
    area = np.append(np.pi * (r * np.sin(face[0])) ** 2, np.pi * r**2 * np.diff(np.sin(face) ** 2))
    cap = np.append(2 * np.pi * r**2 * (1 - np.cos(face[0])), -2 * np.pi * r**2 * np.diff(np.cos(face)))
    nodes = np.concatenate([edge[:1], middle, edge[-1:]])
    apart, cosine = np.diff(nodes), np.cos(2 * np.arctan(np.exp(nodes)))

    def volume(x: float) -> np.ndarray:
        lift = LIFT_FILM + x - JOINT.clearance
        return JOINT.clearance * cap + lift * area + np.append(pocket, np.zeros(cells))

    def flows(pressure: np.ndarray, x: float) -> np.ndarray:
        gap = JOINT.clearance + (LIFT_FILM + x - JOINT.clearance) * cosine
        conductance = np.pi * ((gap[:-1] + gap[1:]) / 2) ** 3 / (12 * JOINT.viscosity * ATMOSPHERE * apart)
        return -conductance * np.diff(np.append(pressure, ATMOSPHERE) ** 2)

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        pressure, x, speed = state[:-2], state[-2], state[-1]
        fed = JOINT.orifices * float(orifice.flow(inlet, max(pressure[0] - ATMOSPHERE, 0.0)))
        net = np.append(fed, flows(pressure, x)[:-1]) - flows(pressure, x)
        change = (ATMOSPHERE * net - pressure * area * speed) / volume(x)
        force = area @ (pressure - ATMOSPHERE) - held - MAGNETS * x
        return np.append(change, [speed, force / MASS])

    def settled(start: np.ndarray) -> np.ndarray:
        still = solve_ivp(
            lambda t, p: rate(t, np.append(p, [0.0, 0.0]))[:-2], (0.0, 1.0), start, method="BDF", rtol=1e-10, atol=1e-3
        )
        return still.y[:, -1]

    held = 0.0
    _, socket = compressible_film(JOINT, LOAD, LIFT_FILM)
    rest = settled(np.full(cells + 1, ATMOSPHERE + 0.5 * socket))
    held = float(area @ (rest - ATMOSPHERE))
    assert held == pytest.approx(LOAD, rel=0.03)
    exact = {"method": "BDF", "rtol": 1e-9, "atol": np.append(1e-12 * rest, [1e-15, 1e-12])}
    found = solve_ivp(rate, (0.0, 0.04), np.append(rest, [1e-8, 0.0]), dense_output=True, **exact)
    tau = np.linspace(0.004, 0.04, 40001)
    x = found.sol(tau)[-2]
    top = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])) + 1
    growth = np.polyfit(tau[top], np.log(x[top]), 1)[0]
    return complex(growth, 2 * np.pi * (len(top) - 1) / (tau[top[-1]] - tau[top[0]]))


@pytest.mark.long
@pytest.mark.parametrize("pocket", [0.0, 15e-9, 60e-9])
def test_a_vibration_grows_and_dies_as_integrated_in_time(pocket: float) -> None:
    least = film().least_damped(MASS, MAGNETS, pocket)
    expected = integrated(LAWS["linear"], pocket)
    assert least.real == pytest.approx(expected.real, abs=0.005 * abs(expected))
    assert least.imag == pytest.approx(expected.imag, rel=0.01)
    assert (least.real > 0) == (pocket == 60e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("lift", [25e-6, 50e-6])
def test_slow_motion_follows_the_curve_of_load_over_lift(law: str, lift: float) -> None:
    """At constant inlet pressure, by central differences of the compressible film's own load."""
    orifice = LAWS[law]
    inlet = inlet_of(orifice, lift)

    def load(at: float) -> float:
        def short(load: float) -> float:
            flow, socket = compressible_film(JOINT, load, at)
            return float(orifice.flow(inlet, socket)) - flow

        return brentq(short, 0.95 * LOAD, 1.05 * LOAD)

    slope = (load(lift + 0.1e-6) - load(lift - 0.1e-6)) / 0.2e-6
    assert float(film(law, lift).impedance(0.0).real) == pytest.approx(-slope, rel=2e-3)


@pytest.mark.parametrize("law", LAWS)
def test_hammer_begins_where_a_vibration_neither_grows_nor_dies(law: str) -> None:
    fed = film(law)
    begins = fed.hammering_pocket(MASS, MAGNETS)
    less, more = (fed.least_damped(MASS, MAGNETS, share * begins) for share in (0.9, 1.1))
    assert less.real < 0 < more.real
    at = fed.least_damped(MASS, MAGNETS, begins)
    assert abs(at.real) < 1e-4 * abs(at)
    held = fed.impedance(at.imag / (2 * np.pi), begins) + MAGNETS - MASS * at.imag**2
    assert abs(complex(held)) < 1e-3 * MASS * at.imag**2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda f: f.least_damped(0.0), "mass = 0, expected above 0 kg"),
        (lambda f: f.least_damped(1.0, 0.0, -1e-9), "air pocket = -1e-09, expected at least 0"),
        (lambda f: f.impedance(-1.0), "frequency = -1, expected at least 0 Hz"),
    ],
)
def test_impossible_questions_are_refused(call: Callable[[FedFilm], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call(film())


@pytest.mark.parametrize(
    ("root", "left"),
    [(-1 + 10j, np.exp(-0.2 * np.pi)), (1 + 10j, np.exp(0.2 * np.pi)), (-3 + 0j, np.exp(-50)), (3 + 0j, np.exp(50))],
)
def test_of_a_vibration_is_left_what_its_decrement_says(root: complex, left: float) -> None:
    assert decay_per_cycle(root) == pytest.approx(left)


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
