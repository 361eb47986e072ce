"""Noise of positions whose standard deviation depends on the direction, as of stereo cameras along the optical axis.

A position has the covariance σ² Ω, trace Ω = 3, with σ² the mean variance of the coordinates. The fit weighs positions
by Ω⁻¹ if the errors of poses left out are then smaller, and equally if not, as with large undeclared effects. The
estimates of equal weights have the covariance

    σ² B (Σ C_iᵀ Ω C_i + PᵀP) B,   B = (Σ C_iᵀ C_i + PᵀP)⁻¹

with the columns C_i of the coordinates of position i, and the prior rows P. With σ² B = F Fᵀ and Q_i = C_i F / σ, the
covariance is F (I + Σ Q_iᵀ (Ω - I) Q_i) Fᵀ. Source: White (1980), A
heteroskedasticity-consistent covariance matrix estimator.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.serial import SerialNoise
from gpmodel.numerics import rank
from gpmodel.numerics.interval import SIGNIFICANCE

LARGEST_LEVERAGE = 0.95
"""Largest leverage of a pose whose residual is used. With a larger leverage, the residual is a rounding error."""
LEAST_VARIANCE = 1e-6
"""Least variance of a direction relative to the mean: noise a thousandth as large changes no stated digit."""


def with_noise(
    problem: Linearised, columns: Array, covariance: Array, sigma: float, left: Array, serial: SerialNoise | None
) -> Array:
    """Return the covariance of least-squares estimates with the noise of each direction and of neighbouring rows.

    columns: derivatives of the rows of `problem` with respect to the estimates. covariance: of the estimates, with
    equal independent noise `sigma`, m, of all rows. left: residuals of the fit over √(1 - leverage), (positions, 3). If
    their noise does not depend significantly on the direction or on the rows before, `covariance` is returned.
    """
    shape = estimated_shape(left)
    if shape is None and serial is None:
        return covariance
    deviation = np.sqrt(np.diag(covariance))
    deviation[deviation == 0.0] = 1.0
    root = deviation[:, None] * rank.square_root(covariance / np.outer(deviation, deviation))
    parts = _by_pose(problem, columns @ root / sigma)
    more = np.zeros((len(root), len(root)))
    if shape is not None:
        more += np.einsum("pik,ij,pjl->kl", parts, shape - np.eye(3), parts, optimize=True)
    if serial is not None:
        more += serial.added(parts, problem.poses.dataset.row)
    root = root @ rank.square_root(np.eye(len(root)) + more)
    return np.asarray(root @ root.T)


def _by_pose(problem: Linearised, values: Array) -> Array:
    """Return rows of a linear problem by pose and coordinate of the position, (poses, 3, ...); zero if unmeasured."""
    pose, component = np.nonzero(problem.weights > 0)
    own = component < 3
    out = np.zeros((len(problem.weights), 3, *values.shape[1:]))
    out[pose[own], component[own]] = values[own]
    return out


@dataclass(frozen=True)
class PositionResiduals:
    """Residuals of complete positions over √(1 - leverage), (positions, 3), m.

    rows: in coordinates of equal noise, as in the linear problem. measured: in the axes of the measurement.
    left_out: measured minus predicted positions, (positions, 3), m, each coordinate predicted without its own value.
    """

    rows: Array
    measured: Array
    left_out: Array

    @classmethod
    def of(cls, problem: Linearised, columns: Array, inverse: Array) -> "PositionResiduals":
        """Return the residuals of a fit; none if joint values are unmeasured, because elimination mixes the rows.

        columns, inverse: fitted columns C, and (CᵀC + PᵀP)⁻¹ with the prior rows P.
        """
        if problem.reduced is not None:
            return cls(*3 * [np.zeros((0, 3))])
        whole = np.all(problem.weights[:, :3] > 0, axis=1)
        left = 1.0 - np.minimum(np.sum((columns @ inverse) * columns, axis=1), LARGEST_LEVERAGE)
        rows, off = (_by_pose(problem, problem.residual / share) for share in (np.sqrt(left), left))
        return cls(rows[whole], *(as_measured(problem, values)[whole] for values in (rows, off)))

    @property
    def sigma(self) -> float:
        """Standard deviation of a coordinate, m."""
        return float(np.sqrt(np.mean(self.measured**2)))

    @cached_property
    def shape(self) -> Array | None:
        """Covariance of the coordinates relative to their mean variance, (3, 3); None for equal noise."""
        return estimated_shape(self.measured)


def as_measured(problem: Linearised, rows: Array) -> Array:
    """Return coordinates of equal noise, (poses, 3), as coordinates in the axes of the measurement."""
    if problem.equal is None:
        return rows
    return np.asarray(np.einsum("nij,nj->ni", np.linalg.pinv(problem.equal), rows))


def estimated_shape(residuals: Array) -> Array | None:
    """Estimate the covariance Ω of a position's coordinates relative to their mean variance, (3, 3), trace 3.

    residuals: (positions, 3). The sign test of sphericity decides whether the noise depends on the direction; if not,
    None is returned. With the mean S of u uᵀ over the unit vectors u = r / |r| of n residuals, n · 15/2 ·
    (trace S² - 1/3) is χ² distributed with 5 degrees of freedom, whatever the distribution of |r|.
    Source: Hallin and Paindaveine (2006), Semiparametrically efficient rank-based inference for shape.
    """
    length = np.linalg.norm(residuals, axis=1)
    unit = residuals[length > 0] / length[length > 0, None]
    if len(unit) <= 3:
        return None
    signs = unit.T @ unit / len(unit)
    if special.chdtrc(5.0, len(unit) * 7.5 * (np.sum(signs**2) - 1.0 / 3.0)) >= SIGNIFICANCE:
        return None
    moments = residuals.T @ residuals
    shape = 3.0 * moments / np.trace(moments) + LEAST_VARIANCE * np.eye(3)
    return np.asarray(shape / (1.0 + LEAST_VARIANCE))


def shape_of(fitted: Linearised) -> Array | None:
    """Return the covariance of `PositionResiduals.shape` from a fit of all columns."""
    basis = rank.orthonormal(fitted.columns)
    return PositionResiduals.of(fitted, basis, np.eye(basis.shape[1])).shape


def independent_share(shape: Array | None) -> float:
    """Return the degrees of freedom of the mean variance of three coordinates over those with equal noise.

    The share is (tr Ω)² / (3 tr Ω²), one third if the noise has one direction alone. Source: Satterthwaite (1946).
    """
    return 1.0 if shape is None else float(np.trace(shape) ** 2 / (3.0 * np.sum(shape**2)))
