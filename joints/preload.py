"""Magnetic preload of a ball and socket, and the largest pull that it resists (thesis section 3.2).

Frame: origin at the ball's centre, z along the socket's axis, out of the socket. The magnets pull the ball along -z,
into the socket. Angles are measured from the z axis; forces in N, lengths in m, angles in rad.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from joints.settings import angle_within, not_negative, positive, require


@dataclass(frozen=True)
class MagnetRing:
    """A ring of `count` magnets of pull `force` [N] and `diameter` [m], at the polar `angle` [rad] in the socket."""

    count: int
    force: float
    angle: float
    diameter: float

    def __post_init__(self) -> None:
        require(self.count >= 1, "magnet count", self.count, "at least 1")
        positive("magnet force", self.force, "N")
        positive("magnet diameter", self.diameter, "m")
        angle_within("magnet ring angle", self.angle, np.pi / 2)

    @property
    def axial_force(self) -> float:
        """Axial force count force cos(angle) [N] of the ring on the ball; lateral components cancel around the ring."""
        return self.count * self.force * float(np.cos(self.angle))

    @property
    def face_area(self) -> float:
        """Total area of the magnet faces of a ring [m^2]."""
        return self.count * np.pi * self.diameter**2 / 4


def total_preload(rings: Sequence[MagnetRing]) -> float:
    """Return the preload [N] of several magnet rings, the sum of their axial forces."""
    return sum(ring.axial_force for ring in rings)


def socket_fixed_limit(preload: ArrayLike, angle: ArrayLike, reaction_angle: float) -> Array:
    """Return the largest pull [N] on the ball at `angle` from the axis, with the socket fixed (Fig 3.7).

    At the angle t of the pull the limit is P / (cos t + sin t cot phi), with preload P and polar angle phi
    (`reaction_angle`) of the socket's reaction. The smallest limit over all angles t is P sin(phi), at t = 90 deg -
    phi: half of P for phi = 30 deg, as in Fig 3.9.
    """
    phi = angle_within("reaction angle", reaction_angle, np.pi / 2)
    theta = _pull_angle(angle)
    return not_negative("preload", preload, "N") / (np.cos(theta) + np.sin(theta) / np.tan(phi))


def contact_directions(contact_angle: float) -> Array:
    """Return unit vectors (3, 3), one per row, from the ball's centre to its three supports, 120 deg apart."""
    angle_within("contact angle", contact_angle, np.pi / 2)
    psi, sine = 2 * np.pi / 3 * np.arange(3), np.sin(contact_angle)
    return np.column_stack([sine * np.cos(psi), sine * np.sin(psi), np.full(3, -np.cos(contact_angle))])


def contact_forces(
    preload: float, pull: ArrayLike, angle: ArrayLike, azimuth: ArrayLike, directions: ArrayLike
) -> Array:
    """Return the normal forces (..., 3) [N] of three supports on a ball under preload and pull; a negative force means
    separation."""
    at_rest, per_newton = _support_responses(angle, azimuth, directions)
    return preload * at_rest + np.asarray(pull, float)[..., None] * per_newton


def three_contact_limit(preload: ArrayLike, angle: ArrayLike, azimuth: ArrayLike, contact_angle: float) -> Array:
    """Return the largest pull [N] at (`angle`, `azimuth`) before the first of three supports unloads, or infinity.

    The pull is limited to the smallest positive P / (cos t - 2 cot(phi) sin t cos(psi - psi_i)) of the supports i, with
    preload P, pull at polar angle t and azimuth psi, and support i at polar angle phi and azimuth psi_i, 120 deg apart.
    For a pull towards a support the minimum is P sin(phi) (0.79 P for phi = 52.5 deg, the 20 % of Fig 3.11); for a pull
    away from a support it is P / sqrt(1 + 4 cot^2 phi) = 0.546 P, which the thesis omits.
    """
    at_rest, per_newton = _support_responses(angle, azimuth, contact_directions(contact_angle))
    unloading = per_newton < 0
    limit: Array = np.where(unloading, at_rest / np.where(unloading, -per_newton, 1.0), np.inf).min(axis=-1)
    return not_negative("preload", preload, "N") * limit


def published_socket_area(radius: ArrayLike, socket_angle: ArrayLike) -> Array:
    """Return the area of the socket as in Tables 3.1 and 4.1, 4 socket_angle radius^2 [m^2]; exact for a hemisphere."""
    alpha = angle_within("socket angle", socket_angle, np.pi / 2)
    return 4 * alpha * positive("socket radius", radius, "m") ** 2


def cap_area(radius: ArrayLike, socket_angle: ArrayLike) -> Array:
    """Return the area [m^2] of the spherical socket, 2 pi radius^2 (1 - cos(socket_angle))."""
    alpha = angle_within("socket angle", socket_angle, np.pi / 2)
    area: Array = 2 * np.pi * positive("socket radius", radius, "m") ** 2 * (1 - np.cos(alpha))
    return area


def projected_area(radius: ArrayLike, socket_angle: ArrayLike) -> Array:
    """Return the projected area pi (r sin alpha)^2 [m^2] of a socket: ball radius r, polar angle alpha of the edge."""
    alpha = angle_within("socket angle", socket_angle, np.pi / 2)
    return np.pi * (positive("socket radius", radius, "m") * np.sin(alpha)) ** 2


def _pull_angle(angle: ArrayLike) -> Array:
    theta = np.asarray(angle, float)
    valid = np.isfinite(theta) & (theta >= 0) & (theta <= np.pi / 2 * (1 + 1e-12))
    require(valid, "pull angle [deg]", np.degrees(theta), "0 to 90 deg")
    return theta


def _support_responses(angle: ArrayLike, azimuth: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    theta, psi = np.broadcast_arrays(_pull_angle(angle), np.asarray(azimuth, float))
    pull = np.stack([np.sin(theta) * np.cos(psi), np.sin(theta) * np.sin(psi), np.cos(theta)], axis=-1)
    inverse = np.linalg.inv(np.asarray(directions, float).T)
    return inverse @ np.array([0.0, 0.0, -1.0]), pull @ inverse.T
