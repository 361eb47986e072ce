"""Information of approximate joint values: each is a reading of the joint with an error.

With the weighted sensitivities A = U S Vᵀ (m, n) of one pose to its free joints, in units of `prior_sigmas`, a step of
the parameters with columns C moves the joints that fit the measurements best by -V S⁺ Uᵀ C step. The values in the
table are believed to differ from those by errors ~ N(0, τ²), so that

    R · step ≈ q_table - q_solved        R = -V S⁺ Uᵀ C, ± τ along the directions of V that the pose shows

What the measurements tell less of than these readings do, as of a ball's turn about its own centre, is known from them
alone; of everything else they are left out, so that it stays what eliminating free angles makes of it. τ shows in how
far the solved joint values lie from the table's.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array
from gpmodel.calibration.unmeasured_joints import TRUNCATION, free_joints, joint_columns, prior_sigmas
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.observed import Observed

LEAST_ERROR = 1e-6
"""Smallest error in units of prior_sigmas, 3.6 mas: smaller differences are rounding."""
LEAST_SIGMA = 1e-12
"""Metres, far below any noise: exact tables."""
ROUNDING = 1e-14
"""Smallest information about a column, as a fraction; less is rounding."""


@dataclass(frozen=True)
class JointReadings:
    """Rows (B, K) and right side (B,) of the table's joint values, in units of `prior_sigmas`, zero along what no pose
    shows. shown: how many directions are."""

    rows: Array
    off: Array
    shown: int

    def error(self, used: int = 0) -> float:
        """τ: RMS of how far the values are off, where they determine so many unknowns."""
        return max(float(np.sqrt(np.sum(self.off**2) / max(self.shown - used, 1))), LEAST_ERROR)

    def alone(self, informed: Array, sigma: float) -> Array:
        """Combinations (B, W) of the readings, orthonormal, that tell more of something than the measurements do.

        informed: the other rows (M, K), measured and believed, each ± sigma. Of generalised eigenvectors v of
        RᵀR / τ² and that plus CᵀC / σ² those with more than half: R v of unit length.
        """
        told, read = informed / max(sigma, LEAST_SIGMA), self.rows / self.error()
        scale = np.sqrt(np.sum(told**2, axis=0) + np.sum(read**2, axis=0))
        scale = np.where(scale > 0, scale, 1.0)
        told, read = told / scale, read / scale
        inner = read.T @ read
        both = inner + told.T @ told + ROUNDING * np.eye(len(scale))
        share, vectors = linalg.eigh(inner, both, check_finite=False)
        more = share > 0.5
        return np.asarray(read @ vectors[:, more] / np.sqrt(share[more]))


def joint_readings(
    mechanism: Mechanism, observed: Observed, off: Array, columns: Array, weights: Array
) -> JointReadings:
    """The readings of the free joints at every pose.

    off: (N, J) joint values as read less those solved. columns: (N, m, K), weighted, before anything is eliminated;
    weights: (N, m), zero where a pose does not count or was not measured.
    """
    free, sigma = list(free_joints(mechanism)), prior_sigmas(mechanism)
    u, s, vt = np.linalg.svd(joint_columns(mechanism, observed) * weights[:, :, None] * sigma, full_matrices=False)
    shown = s > TRUNCATION * np.maximum(s[:, :1], 1e-300)
    inverse = np.where(shown, 1.0 / np.where(shown, s, 1.0), 0.0)
    moved = -np.einsum("nkj,nk,nik,nip->njp", vt, inverse, u, columns, optimize=True)
    seen = np.einsum("nki,nk,nkj,nj->ni", vt, shown, vt, off[:, free] / sigma, optimize=True)
    return JointReadings(moved.reshape(-1, columns.shape[2]), seen.ravel(), int(shown.sum()))
