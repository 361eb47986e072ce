"""The fed film in motion, against the whole equations integrated in time and against its own static curve."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from gpmodel.errors import InputError
from joints.fed_film import FedFilm, fed_film, left_a_cycle_later
from joints.film import FilmGeometry
from joints.orifice import ATMOSPHERE, LinearOrifice, NozzleOrifice, Orifice
from joints.reynolds import compressible_film

JOINT = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)
LOAD, LIFT, MASS, MAGNETS = 100.69, 50e-6, 0.539, -0.2536e6
LAWS = {"linear": LinearOrifice(), "nozzle": NozzleOrifice(150e-6)}


def film(law: str = "linear", lift: float = LIFT) -> FedFilm:
    return fed_film(JOINT, LOAD, LAWS[law], lift)


def inlet_of(orifice: Orifice, lift: float) -> float:
    flow, socket = compressible_film(JOINT, LOAD, lift)
    return float(orifice.inlet_pressure(flow, socket))


def integrated(orifice: Orifice, pocket: float, cells: int = 60) -> complex:
    """s of x ~ exp(s tau): Reynolds' equation and Newton's, not linearised, in s = ln tan(t/2) beyond the ring and one
    chamber within it, from rest 10 nm too high; the growth and the period of what follows."""
    inlet, r = inlet_of(orifice, LIFT), JOINT.ball_radius
    edge = np.linspace(*np.log(np.tan(np.array([JOINT.orifice_angle, JOINT.socket_angle]) / 2)), cells + 1)
    middle = (edge[1:] + edge[:-1]) / 2
    face = 2 * np.arctan(np.exp(edge))
    area = np.append(np.pi * (r * np.sin(face[0])) ** 2, np.pi * r**2 * np.diff(np.sin(face) ** 2))
    cap = np.append(2 * np.pi * r**2 * (1 - np.cos(face[0])), -2 * np.pi * r**2 * np.diff(np.cos(face)))
    nodes = np.concatenate([edge[:1], middle, edge[-1:]])
    apart, cosine = np.diff(nodes), np.cos(2 * np.arctan(np.exp(nodes)))

    def volume(x: float) -> np.ndarray:
        lift = LIFT + x - JOINT.clearance
        return JOINT.clearance * cap + lift * area + np.append(pocket, np.zeros(cells))

    def flows(pressure: np.ndarray, x: float) -> np.ndarray:
        gap = JOINT.clearance + (LIFT + x - JOINT.clearance) * cosine
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
    _, socket = compressible_film(JOINT, LOAD, LIFT)
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
    assert left_a_cycle_later(root) == pytest.approx(left)
