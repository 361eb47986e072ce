"""The film pushed sideways, against Reynolds' equation solved over the whole gap of a ball that is moved."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from joints.film import FilmGeometry
from joints.lateral import CELLS, lateral_stiffness
from joints.orifice import LinearOrifice
from joints.reynolds import SphericalFilm, spherical_film

DEG = np.pi / 180
JOINT = FilmGeometry(25.4e-3, 75.95 * DEG, 20 * DEG, 10.01e-6)
ORIFICE = LinearOrifice(2.0e11, 6e4)
LOAD = 100.69
POLE, ALONG, AROUND = 7.0, 240, 64
"""Depth of the pole's cut below the ring, in s; nodes along s and around."""


def force(moved: tuple[float, float], film: SphericalFilm, flow: tuple[float, float]) -> np.ndarray:
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


def by_differences(film: SphericalFilm, flow: tuple[float, float]) -> np.ndarray:
    """Stiffnesses (2,) across and along the axis [N/m], by central differences of the force."""
    step = 1e-3 * JOINT.clearance
    pairs = [((step, 0.0), (-step, 0.0)), ((0.0, step), (0.0, -step))]
    return np.array([-(force(a, film, flow) - force(b, film, flow))[k] / (2 * step) for k, (a, b) in enumerate(pairs)])


@pytest.mark.parametrize("lift", [6e-6, 20e-6, 50e-6])
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
