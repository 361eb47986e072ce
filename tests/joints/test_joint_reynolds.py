"""Test the film of a sphere against quadrature, small-angle and concentric limits."""

from dataclasses import replace

import numpy as np
import pytest
from instances import some
from scipy.integrate import quad, solve_bvp
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from gpmodel.errors import InputError
from joints.film import Film, FilmGeometry, film_gap, film_resistance, pad_load
from joints.orifice import LinearOrifice, NozzleOrifice, Orifice
from joints.reynolds import (
    CELLS,
    compressible_film,
    lateral_stiffness,
    orifice_spreading_resistance,
    spherical_area,
    spherical_film,
    spherical_pressure,
    spherical_resistance,
)

DEG = np.pi / 180
JOINT = FilmGeometry(25.4e-3, 75.95 * DEG, 20 * DEG, 10.01e-6)
LOAD = 100.69


def gap(geometry: FilmGeometry, lift: float, t: float) -> float:
    return geometry.clearance + (lift - geometry.clearance) * np.cos(t)


@pytest.mark.parametrize("lift", [3e-6, 10.01e-6, 30e-6, 80e-6])
def test_resistance_and_area_by_adaptive_quadrature(lift: float) -> None:
    phi, alpha = JOINT.orifice_angle, JOINT.socket_angle
    ring = quad(lambda t: 1 / (np.sin(t) * gap(JOINT, lift, t) ** 3), phi, alpha, epsrel=1e-12, limit=200)[0]
    load = quad(lambda t: np.sin(t) / gap(JOINT, lift, t) ** 3, phi, alpha, epsrel=1e-12, limit=200)[0]
    assert float(spherical_resistance(JOINT, lift)) == pytest.approx(6 * JOINT.viscosity / np.pi * ring, rel=1e-9)
    assert float(spherical_area(JOINT, lift)) == pytest.approx(np.pi * JOINT.ball_radius**2 * load / ring, rel=1e-9)


def test_pressure_solves_reynolds_equation() -> None:
    lift, socket = 30e-6, 6e4

    def slopes(t: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.vstack([y[1] / (np.sin(t) * film_gap(JOINT, lift, t) ** 3), np.zeros_like(t)])

    angle = np.linspace(JOINT.orifice_angle, JOINT.socket_angle, 200)
    start = np.vstack([np.linspace(socket, 0, 200), np.full(200, -1e-11)])
    scale = 1e-11
    solution = solve_bvp(
        lambda t, y: slopes(t, np.vstack([y[0], y[1] * scale])),
        lambda a, b: np.array([a[0] / socket - 1, b[0] / socket]),
        angle,
        np.vstack([start[0], start[1] / scale]),
        tol=1e-8,
        max_nodes=20000,
    )
    assert solution.success
    computed = spherical_pressure(JOINT, lift, socket, angle, compressible=False)
    assert computed == pytest.approx(solution.sol(angle)[0], abs=1e-3 * socket)


@pytest.mark.parametrize("compressible", [True, False])
def test_load_is_the_pressure_over_the_projected_area(compressible: bool) -> None:
    lift = 40e-6
    socket = compressible_film(JOINT, LOAD, lift)[1] if compressible else LOAD / float(spherical_area(JOINT, lift))
    t = np.linspace(0, JOINT.socket_angle, 40001)
    pressure = spherical_pressure(JOINT, lift, socket, t, compressible)
    load = np.trapezoid(pressure * np.pi * JOINT.ball_radius**2 * np.sin(2 * t), t)
    assert load == pytest.approx(LOAD, rel=1e-6)


def test_concentric_sphere_has_its_closed_resistance() -> None:
    ratio = np.tan(JOINT.socket_angle / 2) / np.tan(JOINT.orifice_angle / 2)
    expected = 6 * JOINT.viscosity / (np.pi * JOINT.clearance**3) * np.log(ratio)
    assert float(spherical_resistance(JOINT, JOINT.clearance)) == pytest.approx(expected, rel=1e-12)


def test_shallow_socket_is_the_flat_pad() -> None:
    alpha = 0.1 * DEG
    shallow = FilmGeometry(1.0, alpha, 0.3 * alpha, 10e-6)
    flat = float(film_resistance(shallow, 20e-6))
    assert float(spherical_resistance(shallow, 20e-6)) == pytest.approx(flat, rel=1e-5)
    area = np.pi * alpha**2 * (1 - 0.09) / (2 * np.log(1 / 0.3))
    assert float(spherical_area(shallow, 20e-6)) == pytest.approx(area, rel=1e-5)
    assert float(pad_load(shallow, 1.0)) * np.pi / (4 * alpha) == pytest.approx(area, rel=1e-9)


@pytest.mark.parametrize("orifice", [LinearOrifice(), NozzleOrifice(2e-4, 0.8)], ids=["linear", "nozzle"])
@pytest.mark.parametrize("lift", [8e-6, 20e-6, 50e-6])
def test_stiffnesses_are_slopes_of_the_load(orifice: Orifice, lift: float) -> None:
    film = spherical_film(JOINT, LOAD, orifice, lift)
    step = lift * 1e-4

    def load_at_flow(d: float) -> float:
        flow = 3 * float(film.flow)
        return flow * float(spherical_resistance(JOINT, d) * spherical_area(JOINT, d))

    def load_at_inlet(d: float) -> float:
        low, high = 0.0, float(film.inlet_pressure)
        resistance = 3 * float(spherical_resistance(JOINT, d))
        for _ in range(200):
            socket = (low + high) / 2
            low, high = (
                (socket, high) if socket < resistance * orifice.flow(film.inlet_pressure, socket) else (low, socket)
            )
        return socket * float(spherical_area(JOINT, d))

    for load, stiffness in (
        (load_at_flow, film.stiffness_constant_flow),
        (load_at_inlet, film.stiffness_constant_inlet),
    ):
        slope = (load(lift + step) - load(lift - step)) / (2 * step)
        assert float(stiffness) == pytest.approx(-slope, rel=1e-5)


def test_compressible_film_tends_to_the_incompressible_one_at_low_load() -> None:
    light = spherical_film(JOINT, 0.1, LinearOrifice(), 30e-6)
    flow, socket = compressible_film(JOINT, 0.1, 30e-6)
    assert flow == pytest.approx(float(light.flow), rel=2e-3)
    assert socket == pytest.approx(float(light.socket_pressure), rel=2e-3)


def test_orifices_spread_their_flow_as_sources_on_a_circle() -> None:
    """Potential at one of N equal sources against the same flow spread over the ring: ln(R/a) - sum ln|1 - w^k|."""
    a, ring = 25e-6, JOINT.ball_radius * np.sin(JOINT.orifice_angle)
    others = sum(np.log(abs(1 - np.exp(2j * np.pi * k / 3))) for k in (1, 2))
    film = float(film_gap(JOINT, 30e-6, JOINT.orifice_angle))
    expected = 6 * JOINT.viscosity / (np.pi * film**3) * (np.log(ring / a) - others)
    assert float(orifice_spreading_resistance(JOINT, 30e-6, 2 * a)) == pytest.approx(expected)


def test_impossible_films_are_refused() -> None:
    with pytest.raises(InputError, match="displacement = -1e-06"):
        film_gap(JOINT, -1e-6, 0.3)
    with pytest.raises(InputError, match="film gap = 0, expected above 0 m"):
        film_gap(JOINT, 0.0, 0.0)
    with pytest.raises(InputError, match=r"orifice diameter = 0\.01, expected smaller"):
        orifice_spreading_resistance(JOINT, 30e-6, 0.01)
    with pytest.raises(InputError, match="load = 0, expected above 0 N"):
        compressible_film(JOINT, 0.0, 30e-6)
    with pytest.raises(InputError, match="viscosity = 0"):
        replace(JOINT, viscosity=0.0)


ORIFICE = LinearOrifice(2.0e11, 6e4)
POLE, ALONG, AROUND = 7.0, 240, 64
"""Depth of the pole's cut below the ring, in s; nodes along s and around."""


def force(moved: tuple[float, float], film: Film, flow: tuple[float, float]) -> np.ndarray:
    """Force (2,) [N] across and along the axis on a ball moved by (across, away from the socket) [m].

    In s = ln tan(t/2) Reynolds' equation is div(h³ grad p) = 0 of a plane strip; the ring feeds flow[0] + flow[1] p
    [m³/s] in all. Finite volumes, the pole cut off without flux.
    """
    ring, edge = (np.log(np.tan(t / 2)) for t in (JOINT.orifice_angle, JOINT.socket_angle))
    outer = round(ALONG * (edge - ring) / (edge - ring + POLE)) + 40
    s = np.concatenate([np.linspace(ring - POLE, ring, ALONG - outer), np.linspace(ring, edge, outer + 1)[1:]])
    f = 2 * np.pi * np.arange(AROUND) / AROUND

    def gap(s: np.ndarray, f: np.ndarray) -> np.ndarray:
        lift = JOINT.clearance + (float(film.displacement) + moved[1] - JOINT.clearance) * -np.tanh(s)
        return lift - moved[0] / np.cosh(s) * np.cos(f)

    step, turn = np.diff(s), 2 * np.pi / AROUND
    width = np.concatenate([step[:1] / 2, (step[1:] + step[:-1]) / 2, step[-1:] / 2])
    number = np.arange(ALONG * AROUND).reshape(ALONG, AROUND)
    along = gap((s[1:] + s[:-1])[:, None] / 2, f) ** 3 * turn / step[:, None]
    around = gap(s[:, None], f + turn / 2) ** 3 * width[:, None] / turn
    ends = [(number[1:], number[:-1], along), (number, np.roll(number, -1, axis=1), around)]
    rows, columns, values = [], [], []
    for one, other, conducts in ends:
        for a, b, sign in ((one, other, 1.0), (other, one, 1.0), (one, one, -1.0), (other, other, -1.0)):
            rows, columns, values = [*rows, a.ravel()], [*columns, b.ravel()], [*values, sign * conducts.ravel()]
    fed = number[ALONG - outer - 1]
    each = 12 * JOINT.viscosity / AROUND
    matrix = coo_matrix(
        (np.concatenate([*values, np.full(AROUND, each * flow[1])]),
         (np.concatenate([*rows, fed]), np.concatenate([*columns, fed]))), shape=(number.size,) * 2,
    ).tocsr()  # fmt: skip
    source = np.zeros(number.size)
    source[fed] = -each * flow[0]
    inside = number[:-1].ravel()
    pressure = np.zeros(number.size)
    pressure[inside] = spsolve(matrix[inside][:, inside], source[inside])
    area = JOINT.ball_radius**2 * (width / np.cosh(s) ** 2)[:, None] * turn * pressure.reshape(ALONG, AROUND)
    return np.array([-np.sum(area / np.cosh(s)[:, None] * np.cos(f)), np.sum(area * -np.tanh(s)[:, None])])


def by_differences(film: Film, flow: tuple[float, float]) -> np.ndarray:
    """Stiffnesses (2,) across and along the axis [N/m], by central differences of the force."""
    step = 1e-3 * JOINT.clearance
    pairs = [((step, 0.0), (-step, 0.0)), ((0.0, step), (0.0, -step))]
    return np.array([-(force(a, film, flow) - force(b, film, flow))[k] / (2 * step) for k, (a, b) in enumerate(pairs)])


@pytest.mark.parametrize("lift", some([6e-6, 20e-6, 50e-6], 20e-6))
@pytest.mark.parametrize("fed", ["flow", "inlet"])
def test_both_stiffnesses_are_those_of_a_ball_that_is_moved(lift: float, fed: str) -> None:
    film = spherical_film(JOINT, LOAD, ORIFICE, lift)
    slope = JOINT.orifices * float(ORIFICE.flow_slope(film.inlet_pressure, film.socket_pressure)) * (fed == "inlet")
    flow = JOINT.orifices * float(film.flow) - slope * float(film.socket_pressure), slope
    across, along = by_differences(film, flow)
    assert along == pytest.approx(float(getattr(film, f"stiffness_constant_{fed}")), rel=0.02)
    assert float(lateral_stiffness(JOINT, film, ORIFICE if fed == "inlet" else None)) == pytest.approx(across, rel=0.02)


def test_the_mesh_is_fine_enough() -> None:
    film = spherical_film(JOINT, LOAD, ORIFICE, [6e-6, 50e-6])
    coarse, fine = (lateral_stiffness(JOINT, film, ORIFICE, cells) for cells in (CELLS, 4 * CELLS))
    np.testing.assert_allclose(coarse, fine, rtol=1e-4)
