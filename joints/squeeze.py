"""Squeeze-film damping of the spherical gap: what the air resists when the ball moves along the axis (chapter 6)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded

from gpmodel.arrays import Array
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

    Linearised Reynolds: (1/sin t) d/dt(sin t h^3 dp/dt) = (12 mu r^2 / p_a) i omega (h p + p_a x cos t), p = 0 at
    the edge, by finite volumes of equal angle. Im / omega tends to `squeeze_damping` for slow motion; the real
    part is the trapped air's spring.
    """
    omega = 2 * np.pi * np.atleast_1d(positive("frequency", frequency, "Hz"))
    r, step = geometry.ball_radius, geometry.socket_angle / cells
    faces = step * np.arange(1, cells + 1)
    centres = faces - step / 2
    volume = np.cos(centres - step / 2) - np.cos(centres + step / 2)
    conduct = np.sin(faces) * film_gap(geometry, displacement, faces) ** 3 / step
    conduct[-1] *= 2
    gap = film_gap(geometry, displacement, centres)
    bands = np.zeros((3, cells), complex)
    bands[0, 1:] = bands[2, :-1] = conduct[:-1]
    flux = -(conduct + np.concatenate([[0.0], conduct[:-1]]))
    weight = 2 * np.pi * r**2 * volume * np.cos(centres)
    result = np.empty(omega.shape, complex)
    for index, rate in enumerate(omega):
        source = 12j * geometry.viscosity * r**2 * rate * volume
        bands[1] = flux - source * gap / ATMOSPHERE
        result[index] = -weight @ solve_banded((1, 1), bands, source * np.cos(centres))
    return result.reshape(np.shape(frequency))
