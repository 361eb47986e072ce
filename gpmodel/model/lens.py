"""A pinhole camera with Brown's distortion: points to pixels, and pixels to directions.

    x = X / Z, y = Y / Z, r² = x² + y²,  d = 1 + k1 r² + k2 r⁴ + k3 r⁶
    x' = d x + 2 p1 x y + p2 (r² + 2 x²),   y' = d y + p1 (r² + 2 y²) + 2 p2 x y,   u = fx x' + cx,  v = fy y' + cy

Source: Brown (1971). Distortion coefficients have OpenCV's order.
"""

import numpy as np

from gpmodel.arrays import Array

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
UNDISTORTING = 20
"""Number of fixed-point iterations that remove distortion; each iteration gains two digits for a usual lens."""


def pixels(points: Array, lens: Array) -> Array:
    """Return pixels u, v (points, 2) of points (points, 3) in the frame of the camera, m, z forward. lens: nine
    parameters per point in the order of NAMES."""
    fx, fy, cx, cy = lens.T[:4]
    x, y = _distorted(points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], lens)
    return np.column_stack([fx * x + cx, fy * y + cy])


def _distorted(x: Array, y: Array, lens: Array) -> tuple[Array, Array]:
    k1, k2, p1, p2, k3 = lens.T[4:]
    r2 = x * x + y * y
    d = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return d * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), d * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def by_point(points: Array, lens: Array) -> Array:
    """Return the derivatives (points, 2, 3) of the pixels with respect to the coordinates of the points, px/m."""
    x, y, z = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], points[:, 2]
    fx, fy, _, _, k1, k2, p1, p2, k3 = lens.T
    r2 = x * x + y * y
    d, slope = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    xx = d + slope * x * x + 2 * p1 * y + 6 * p2 * x
    xy = slope * x * y + 2 * p1 * x + 2 * p2 * y
    yy = d + slope * y * y + 6 * p1 * y + 2 * p2 * x
    out = np.empty((len(points), 2, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 0, 2] = fx * xx / z, fx * xy / z, -fx * (xx * x + xy * y) / z
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = fy * xy / z, fy * yy / z, -fy * (xy * x + yy * y) / z
    return out


def by_lens(points: Array, lens: Array) -> Array:
    """Return the derivatives (points, 2, 9) of the pixels with respect to the parameters of the lens."""
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    fx, fy = lens.T[:2]
    r2 = x * x + y * y
    out = np.zeros((len(points), 2, 9))
    out[:, 0, 0], out[:, 1, 1] = _distorted(x, y, lens)
    out[:, 0, 2] = out[:, 1, 3] = 1.0
    for k, power in ((4, r2), (5, r2**2), (8, r2**3)):
        out[:, 0, k], out[:, 1, k] = fx * x * power, fy * y * power
    out[:, 0, 6], out[:, 1, 6] = fx * 2 * x * y, fy * (r2 + 2 * y * y)
    out[:, 0, 7], out[:, 1, 7] = fx * (r2 + 2 * x * x), fy * 2 * x * y
    return out


def directions(seen: Array, lens: Array) -> Array:
    """Return directions X/Z, Y/Z without lens distortion from pixels (points, 2), by fixed-point iterations."""
    wide = np.broadcast_to(lens, (len(seen), 9))
    target = (seen - lens[2:4]) / lens[:2]
    out = target.copy()
    for _ in range(UNDISTORTING):
        out = out + target - np.column_stack(_distorted(out[:, 0], out[:, 1], wide))
    return out
