"""Noise of positions whose standard deviation depends on the direction, as of stereo cameras along the optical axis.

The fit weighs the three coordinates of a position equally, and its noise σ² is their mean variance. With the covariance
σ² Ω of a position, trace Ω = 3, the estimates have the covariance

    σ² B (Σ C_iᵀ Ω C_i + PᵀP) B,   B = (Σ C_iᵀ C_i + PᵀP)⁻¹

with the columns C_i of the coordinates of position i, and the prior rows P. With σ² B = F Fᵀ and Q_i = C_i F / σ, the
covariance is F (I + Σ Q_iᵀ (Ω - I) Q_i) Fᵀ. Source: White (1980), A
heteroskedasticity-consistent covariance matrix estimator.
"""

import numpy as np
from scipy import sparse, special

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised
from gpmodel.numerics import rank
from gpmodel.numerics.interval import SIGNIFICANCE

LARGEST_LEVERAGE = 0.95
"""Largest leverage of a pose whose residual is used. With a larger leverage, the residual is a rounding error."""
LEAST_VARIANCE = 1e-6
"""Least variance of a direction relative to the mean: noise a thousandth as large changes no stated digit."""


def with_directions(problem: Linearised, columns: Array, covariance: Array, sigma: float) -> Array:
    """Return the covariance of least-squares estimates with the noise of each direction.

    columns: derivatives of the rows of `problem` with respect to the estimates. covariance: of the estimates, with
    equal noise `sigma`, m, in all directions. If the noise does not differ significantly, `covariance` is returned.
    """
    if problem.reduced is not None:
        return covariance
    shape = noise_shape(_residuals(problem, columns, covariance / sigma**2))
    if np.array_equal(shape, np.eye(3)):
        return covariance
    deviation = np.sqrt(np.diag(covariance))
    deviation[deviation == 0.0] = 1.0
    root = deviation[:, None] * rank.square_root(covariance / np.outer(deviation, deviation))
    parts = _by_pose(problem, columns @ root / sigma)
    more = np.einsum("pik,ij,pjl->kl", parts, shape - np.eye(3), parts, optimize=True)
    root = root @ rank.square_root(np.eye(len(root)) + more)
    return np.asarray(root @ root.T)


def _by_pose(problem: Linearised, values: Array) -> Array:
    """Return rows of a linear problem by pose and coordinate of the position, (poses, 3, ...); zero if unmeasured."""
    pose, component = np.nonzero(problem.weights > 0)
    own = component < 3
    out = np.zeros((len(problem.weights), 3, *values.shape[1:]))
    out[pose[own], component[own]] = values[own]
    return out


def _residuals(problem: Linearised, columns: Array, inverse: Array) -> Array:
    """Return the residuals of complete positions, (positions, 3), m, divided by √(1 - leverage)."""
    leverage = np.minimum(np.sum((columns @ inverse) * columns, axis=1), LARGEST_LEVERAGE)
    whole = np.all(problem.weights[:, :3] > 0, axis=1)
    return _by_pose(problem, problem.residual / np.sqrt(1.0 - leverage))[whole]


def noise_shape(residuals: Array) -> Array:
    """Estimate the covariance Ω of a position's coordinates relative to their mean variance, (3, 3), trace 3.

    residuals: (positions, 3). The sign test of sphericity decides whether the noise depends on the direction; if not, Ω
    is the unit matrix. With the mean S of u uᵀ over the unit vectors u = r / |r| of n residuals, n · 15/2 ·
    (trace S² - 1/3) is χ² distributed with 5 degrees of freedom, whatever the distribution of |r|.
    Source: Hallin and Paindaveine (2006), Semiparametrically efficient rank-based inference for shape.
    """
    length = np.linalg.norm(residuals, axis=1)
    unit = residuals[length > 0] / length[length > 0, None]
    if len(unit) <= 3:
        return np.eye(3)
    signs = unit.T @ unit / len(unit)
    if special.chdtrc(5.0, len(unit) * 7.5 * (np.sum(signs**2) - 1.0 / 3.0)) >= SIGNIFICANCE:
        return np.eye(3)
    moments = residuals.T @ residuals
    shape = 3.0 * moments / np.trace(moments) + LEAST_VARIANCE * np.eye(3)
    return np.asarray(shape / (1.0 + LEAST_VARIANCE))


def noise_of(fitted: Linearised) -> Array:
    """Return the covariance Ω of `noise_shape` from the residuals of a fit of all columns; the unit matrix if joint
    values are unmeasured."""
    if fitted.reduced is not None:
        return np.eye(3)
    basis = rank.orthonormal(fitted.columns)
    return noise_shape(_residuals(fitted, basis, np.eye(basis.shape[1])))


def noise_root(shape: Array, components: IntArray) -> Array:
    """Return F with F Fᵀ the covariance of the components of one pose: Ω = `shape` of its coordinates (0, 1, 2), and
    the unit matrix of the others. components: in ascending order."""
    out, count = np.eye(len(components)), int(np.count_nonzero(components < 3))
    out[:count, :count] = np.linalg.cholesky(shape[np.ix_(components[:count], components[:count])])
    return out


def equalising(problem: Linearised, shape: Array) -> sparse.csr_matrix | None:
    """Return the matrix that combines the rows of each pose so that their noise is equal; None for equal noise."""
    if problem.reduced is not None or np.array_equal(shape, np.eye(3)):
        return None
    pose, component = np.nonzero(problem.weights > 0)
    parts = np.split(component, np.flatnonzero(np.diff(pose)) + 1)
    return sparse.block_diag([np.linalg.inv(noise_root(shape, part)) for part in parts], format="csr")
