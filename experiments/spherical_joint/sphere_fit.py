"""Sphere fit: centre and radius that measured points share, algebraic start, geometric answer, with uncertainty.

    ε_i = R - |p_i - c|,   F(c, R) = min Σ ε_i²

Source: Robertson (2003), Figure 3.12; the start is linear in c and R² - |c|² (Coope 1993).
"""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.unmeasured_joints import sphere_flaw
from gpmodel.errors import InputError

MAX_ITERATIONS = 50
STEP_TOLERANCE = 1e-13


@dataclass(frozen=True)
class SphereFit:
    """centre: (3,) m. radius: m. residual: (N,) measured minus fitted radius, m. sigma: m, of one radial residual.

    covariance: (4, 4) of centre and radius, m². status: converged or stalled; reason says why.
    """

    centre: Array
    radius: float
    residual: Array
    sigma: float
    covariance: Array
    iterations: int
    status: str
    reason: str

    @property
    def stderr(self) -> Array:
        """Standard deviations (4,) of the centre's coordinates and the radius, m."""
        return np.sqrt(np.diag(self.covariance))


def algebraic_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of |p|² = 2 p·c + (R² - |c|²) by linear least squares on points (N, 3), m."""
    middle = points.mean(axis=0)
    shifted = points - middle
    system = np.column_stack([2 * shifted, np.ones(len(points))])
    solution = np.linalg.lstsq(system, np.sum(shifted**2, axis=1), rcond=None)[0]
    return solution[:3] + middle, float(np.sqrt(solution[3] + solution[:3] @ solution[:3]))


def fit_sphere(points: Array, where: str = "points") -> SphereFit:
    """The sphere nearest to points (N, 3) in radial distance, m, by Gauss-Newton.

    Raises InputError where the points determine none: fewer than 4, alike, in one plane, or not finite.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{where}: points of shape {points.shape}; expected finite x, y and z in every row")
    if flaw := sphere_flaw(points, where):
        raise InputError(flaw)
    centre, radius = algebraic_sphere(points)
    status, reason = "stalled", f"still moving after {MAX_ITERATIONS} iterations"
    iterations = 0
    while iterations < MAX_ITERATIONS and status == "stalled":
        iterations += 1
        rays = points - centre
        lengths = np.linalg.norm(rays, axis=1)
        columns = np.column_stack([rays / lengths[:, None], np.ones(len(points))])
        step = np.linalg.lstsq(columns, lengths - radius, rcond=None)[0]
        centre, radius = centre + step[:3], radius + float(step[3])
        if np.abs(step).max() < STEP_TOLERANCE * max(radius, 1.0):
            status, reason = "converged", "the last step moved neither centre nor radius"
    residual = np.linalg.norm(points - centre, axis=1) - radius
    sigma = float(np.sqrt(np.sum(residual**2) / max(len(points) - 4, 1)))
    covariance = sigma**2 * np.linalg.pinv(columns.T @ columns)
    return SphereFit(centre, radius, residual, sigma, covariance, iterations, status, reason)
