"""Squeeze-film damping of the spherical gap: what the air resists when the ball moves along the axis (chapter 6)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpmodel.arrays import Array
from joints.fed_film import linearised_film
from joints.film import FilmGeometry, film_gap
from joints.limits import not_negative, positive
from joints.orifice import ATMOSPHERE


def squeeze_damping(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """c = 6 pi mu r^4 integral from 0 to alpha of sin^3 t / h^3 dt [N s/m], incompressible, no feed.

    From Reynolds' equation with dh/dt = v cos t: dp/dt = 6 mu v r^2 sin t / h^3. For a small cap of radius R at
    gap h it is the disc's 3 pi mu R^4 / (2 h^3).
    """
    nodes, weights = np.polynomial.legendre.leggauss(48)
    angle = geometry.socket_angle * (nodes + 1) / 2
    gap = film_gap(geometry, np.asarray(displacement, float)[..., None], angle)
    integral = np.sum(weights * np.sin(angle) ** 3 / gap**3, axis=-1) * geometry.socket_angle / 2
    return 6 * np.pi * geometry.viscosity * geometry.ball_radius**4 * integral


def squeeze_number(geometry: FilmGeometry, displacement: ArrayLike, frequency: ArrayLike) -> Array:
    """12 mu omega (r alpha)^2 / (p_a h^2), h at the socket's edge: air escapes well below 1, and is a spring above."""
    gap = film_gap(geometry, displacement, geometry.socket_angle)
    omega = 2 * np.pi * not_negative("frequency", frequency, "Hz")
    length = geometry.ball_radius * geometry.socket_angle
    return 12 * geometry.viscosity * omega * length**2 / (ATMOSPHERE * gap**2)


def squeeze_impedance(
    geometry: FilmGeometry, displacement: float, frequency: ArrayLike, cells: int = 400
) -> NDArray[np.complex128]:
    """Complex stiffness -F/x [N/m] of the unfed isothermal film at atmospheric mean pressure.

    Im / omega tends to `squeeze_damping` for slow motion; the real part is the trapped air's spring.
    """
    return linearised_film(geometry, displacement, nodes=cells).impedance(positive("frequency", frequency, "Hz"))
