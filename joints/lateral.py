"""The spherical film pushed sideways: what it resists when the ball moves across the axis.

A ball moved by x across the axis changes the gap h(t) by -x sin t cos f at azimuth f, and by the first order of x its
pressure p(t) by x p1(t) cos f. Of Reynolds' equation (incompressible, `joints.reynolds`) that leaves

    d/dt [ sin t (h³ p1' - 3 h² sin t p') ] - h³ p1 / sin t = -(6 mu / pi) N (dq/dp) p1  at the ring of the orifices,

p1 = 0 at the pole and at the edge; q: what one orifice lets through. Turning the ball about its own centre changes no
gap: the film has no stiffness of tilt, and about a point at a distance L from the centre it has L² times this one.
"""

import numpy as np
from scipy.linalg import solve_banded

from gpmodel.arrays import Array
from joints.film import FilmGeometry, film_gap
from joints.orifice import Orifice
from joints.reynolds import SphericalFilm, spherical_resistance

CELLS = 800
"""Cells of the arc from the pole to the edge; twice as many change the stiffness by 1e-5."""


def lateral_stiffness(
    geometry: FilmGeometry, film: SphericalFilm, orifice: Orifice | None = None, cells: int = CELLS
) -> Array:
    """-dF/dx [N/m] across the axis at each displacement of a film, pi r² of the integral of p1 sin² t.

    At constant inlet pressure with the orifices' law, at constant flow of each azimuth without one.
    """
    pressures = film.inlet_pressure, film.socket_pressure
    slopes = np.zeros_like(film.flow) if orifice is None else orifice.flow_slope(*pressures)
    rows = zip(film.displacement.flat, film.socket_pressure.flat, slopes.flat, strict=True)
    found = [_lateral(geometry, float(lift), float(socket), float(slope), cells) for lift, socket, slope in rows]
    return np.array(found).reshape(film.displacement.shape)


def _lateral(geometry: FilmGeometry, lift: float, socket: float, flow_slope: float, cells: int) -> float:
    """By finite volumes around nodes, one of them at the ring of the orifices."""
    ring, edge = geometry.orifice_angle, geometry.socket_angle
    inner = max(round(cells * ring / edge), 4)
    node = np.concatenate([np.linspace(0.0, ring, inner + 1), np.linspace(ring, edge, cells - inner + 1)[1:]])
    middle, step = (node[1:] + node[:-1]) / 2, np.diff(node)
    gap = film_gap(geometry, lift, middle)
    outward = 6 * geometry.viscosity * socket / (np.pi * float(spherical_resistance(geometry, lift)))
    driven = np.where(middle > ring, 3 * np.sin(middle) * outward / gap, 0.0)
    conduct = np.sin(middle) * gap**3 / step
    width = (step[1:] + step[:-1]) / 2
    bands = np.zeros((3, len(node) - 2))
    bands[0, 1:] = bands[2, :-1] = conduct[1:-1]
    bands[1] = -conduct[1:] - conduct[:-1] - width * film_gap(geometry, lift, node[1:-1]) ** 3 / np.sin(node[1:-1])
    bands[1, inner - 1] += 6 * geometry.viscosity / np.pi * geometry.orifices * flow_slope
    pressure = solve_banded((1, 1), bands, -np.diff(driven))
    return float(np.pi * geometry.ball_radius**2 * np.sum(width * pressure * np.sin(node[1:-1]) ** 2))
