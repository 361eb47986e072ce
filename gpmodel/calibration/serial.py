"""Noise of positions that neighbouring rows share, such as a set-up that drifts.

The coordinates of positions i and j, in rows of the table n_i and n_j, have the covariance

    σ² ((1 - a) δ_ij + a ρ^|n_i - n_j|)

with the share a of the variance σ² that drifts, and the correlation ρ of the drift from row to row (white noise and
autoregressive noise of first order). a, ρ and σ maximise the restricted likelihood of the residuals of a fit.
Source: Box, Jenkins and Reinsel (2008), 3.2; Patterson and Thompson (1971), restricted likelihood.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised
from gpmodel.model.memory import clock_of
from gpmodel.numerics.interval import SIGNIFICANCE

MEMORIES = (1.0, 4.0, 16.0, 64.0)
"""Grid of the number of rows in which the correlation of the drift falls to 1/e, -1 / log ρ."""
SHARES = np.linspace(0.0, 0.98, 50)
"""Grid of the share a of the variance that drifts."""
LONGEST = 100
"""Number of consecutive positions from which the noise is estimated. The restricted likelihood needs the cube of it."""


@dataclass(frozen=True)
class SerialNoise:
    """Noise that neighbouring rows share.

    share: share a of the variance that drifts. memory: number of rows in which its correlation falls to 1/e.
    growth: variance σ² relative to the mean square of the residuals over their degrees of freedom.
    """

    share: float
    memory: float
    growth: float

    def added(self, parts: Array, rows: IntArray) -> Array:
        """Return Σ_ij Q_iᵀ V_ij Q_j - Σ_i Q_iᵀ Q_i with the covariance V of positions relative to `growth`.

        parts: Q_i, (positions, 3, columns). rows: number of the row of each position in the table.
        """
        order = np.argsort(rows, kind="stable")
        parts, rows = parts[order], rows[order]
        decay = np.exp(-np.diff(rows) / self.memory)
        later, cross = np.zeros(parts.shape[1:]), np.zeros(2 * parts.shape[2:])
        for k in range(len(parts) - 2, -1, -1):
            later = decay[k] * (parts[k + 1] + later)
            cross += parts[k].T @ later
        alone = np.einsum("pik,pil->kl", parts, parts, optimize=True)
        return np.asarray(self.growth * (alone + self.share * (cross + cross.T)) - alone)

    @property
    def independent(self) -> float:
        """Degrees of freedom of the mean square over those of white noise: 1 / (1 + 2 Σ_k a² ρ^2k) (Bartlett 1935)."""
        square = np.exp(-2.0 / self.memory)
        return float(1.0 / (1.0 + 2.0 * self.share**2 * square / (1.0 - square)))


def serial_noise(problem: Linearised, columns: Array, residuals: Array) -> SerialNoise | None:
    """Estimate the noise that neighbouring rows share; None if it is not significant, or the order of the rows unknown.

    columns: fitted columns of the rows. residuals: of complete positions, (positions, 3), m, over √(1 - leverage).
    """
    if clock_of(problem.poses.dataset) is None or not neighbours_alike(residuals):
        return None
    pose, component = np.nonzero(problem.weights > 0)
    whole = np.flatnonzero(np.all(problem.weights[:, :3] > 0, axis=1))
    first = max(0, (len(whole) - LONGEST) // 2)
    own = np.isin(pose, whole[first : first + LONGEST]) & (component < 3)
    pose, component, left = problem.poses.dataset.row[pose[own]], component[own], problem.residual[own]
    q = np.linalg.qr(columns[own], mode="complete")[0][:, np.linalg.matrix_rank(columns[own]) :]
    if not q.shape[1]:
        return None
    best = (-np.inf, 0.0, 1.0, 1.0)
    alike = component[:, None] == component[None]
    for memory in MEMORIES:
        drift = alike * np.exp(-np.abs(pose[:, None] - pose[None]) / memory)
        values, vectors = np.linalg.eigh(q.T @ drift @ q)
        squares = (vectors.T @ (q.T @ left)) ** 2
        scaled = 1.0 - SHARES[:, None] + SHARES[:, None] * np.maximum(values, 0.0)
        variance = np.mean(squares / scaled, axis=1)
        likelihood = -0.5 * (len(squares) * np.log(variance) + np.log(scaled).sum(axis=1))
        k = int(np.argmax(likelihood))
        if likelihood[k] > best[0]:
            best = (float(likelihood[k]), float(SHARES[k]), memory, float(variance[k] / np.mean(squares)))
    return SerialNoise(*best[1:]) if best[1] > 0.0 else None


def neighbours_alike(residuals: Array) -> bool:
    """Return whether residuals of neighbouring positions, (positions, 3), are significantly alike.

    Their correlation has the standard error 1 / √pairs. Source: Durbin and Watson (1950).
    """
    square = np.sum(residuals**2) / max(residuals.size, 1)
    pairs = residuals[1:].size
    if square == 0.0 or not pairs:
        return False
    correlation = np.sum(residuals[1:] * residuals[:-1]) / pairs / square
    return bool(special.ndtr(-correlation * np.sqrt(pairs)) < SIGNIFICANCE)
