"""Surfaces that a tool may touch: a plane, a sphere, a line, a point, and the distance to each of them.

In the frame of the surface, a plane is z = 0, a line the z axis, a sphere is about the origin, a point the origin.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.numerics import se3

ALONG_A_LINE = 0.01
"""Least ratio of width to length of the region that touches of a plane cover. With a smaller ratio, the rotation of the
plane about the long direction is unknown."""


@dataclass(frozen=True)
class Surface:
    """A kind of surface that a tool may touch.

    needs: number of touches that determine the surface.
    axes: indices, in the order Tx to Rz, of the observable twists of the surface's frame.
    gap: function from points (points, 3) in the surface's frame to gaps, m; for a sphere the distance to its centre.
    slope: function from points to the derivatives (points, gaps, 3) of the gaps.
    place: function from touches (touches, 3) in the root and radius (NaN if unknown) to frame (4, 4) and radius, m.
    """

    needs: int
    axes: tuple[int, ...]
    gap: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    place: Callable[[Array, float], tuple[Array, float]]


def aligned(centre: Array, z: Array) -> Array:
    """Return frames (..., 4, 4) at points (..., 3), with unit directions (..., 3) as their z axes."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(z), axis=-1)], z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    out = np.zeros((*z.shape[:-1], 4, 4))
    out[..., :3, :3] = np.stack([x, np.cross(z, x), z], axis=-1)
    out[..., :3, 3], out[..., 3, 3] = centre, 1.0
    return out


def _place_plane(points: Array, radius: float) -> tuple[Array, float]:
    centre = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
    if spread[1] < ALONG_A_LINE * spread[0]:
        raise InputError("touched along a line; expected touches spread over the plane")
    return aligned(centre, axes[2]), radius


def _place_line(points: Array, radius: float) -> tuple[Array, float]:
    centre = points.mean(axis=0)
    return aligned(centre, np.linalg.svd(points - centre, full_matrices=False)[2][0]), radius


def _place_sphere(points: Array, radius: float) -> tuple[Array, float]:
    """Fit a sphere: |p|² = 2 p·c + (r² - |c|²) for touches p, centre c, and radius r if it is unknown."""
    middle = points.mean(axis=0)
    p = points - middle
    _, spread, _ = np.linalg.svd(p, full_matrices=False)
    if spread[2] < ALONG_A_LINE * spread[0]:
        raise InputError("touched along one circle; expected touches spread over the sphere")
    found = np.linalg.lstsq(np.column_stack([2 * p, np.ones(len(p))]), np.sum(p**2, axis=1), rcond=None)[0]
    size = float(np.sqrt(max(found[3] + found[:3] @ found[:3], 0.0)))
    return se3.shift(middle + found[:3]), size if np.isnan(radius) else radius


def _place_point(points: Array, radius: float) -> tuple[Array, float]:
    return se3.shift(points.mean(axis=0)), radius


def _off_sphere(points: Array) -> Array:
    return np.asarray(np.linalg.norm(points, axis=1, keepdims=True))


def _away(points: Array) -> Array:
    return (points / _off_sphere(points))[:, None, :]


def _height(points: Array) -> Array:
    return points[:, 2:].copy()


def _across(points: Array) -> Array:
    return points[:, :2].copy()


def _itself(points: Array) -> Array:
    return points.copy()


def _everywhere(rows: Array, points: Array) -> Array:
    return np.broadcast_to(rows, (len(points), *rows.shape))


SURFACES = {
    "on_plane": Surface(3, (2, 3, 4), _height, partial(_everywhere, np.eye(3)[2:]), _place_plane),
    "on_sphere": Surface(4, (0, 1, 2), _off_sphere, _away, _place_sphere),
    "point": Surface(1, (0, 1, 2), _itself, partial(_everywhere, np.eye(3)), _place_point),
    "end": Surface(1, (2,), _height, partial(_everywhere, np.eye(3)[2:]), _place_point),
    "on_line": Surface(2, (0, 1, 3, 4), _across, partial(_everywhere, np.eye(3)[:2]), _place_line),
}
"""Kinds of surfaces by the column of the table with the name of the touched surface; "point" is a shared point, "end"
an end of a bar along the z axis."""
