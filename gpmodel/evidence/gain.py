"""What a group is worth by marginal likelihood, as a function of its variance, for very many groups at once.

With C the covariance of what is in the model without the group, S = XᵀC⁻¹X = V diag(s) Vᵀ and q = VᵀXᵀC⁻¹y:

    gain(a) = ½ Σ_i [ a q_i² / (1 + a s_i) - ln(1 + a s_i) ]        nats

Source: Tipping and Faul (2003), for groups of columns in place of single ones.
"""

import numpy as np

from gpmodel.arrays import Array

DECADES = 10.0
GRID = 24
REFINEMENTS = 12
"""The variance is sought over so many powers of ten below the largest; at so many places; by so many steps of a golden
section between the best two places, to a hundredth of a nat."""


def fitted(variance: Array, s: Array, q: Array) -> Array:
    """Σ_i a q_i² / (1 + a s_i) (G,), what each of G groups takes off yᵀC⁻¹y at its variance (G,)."""
    return np.asarray(np.sum(variance[:, None] * q**2 / (1.0 + variance[:, None] * np.maximum(s, 0.0)), axis=1))


def with_own_noise(gains: Array, fit: Array, mismatch: float) -> Array:
    """Gains (G,) where the noise is estimated again with each group in it, Q (G,) what it takes off E = yᵀC⁻¹y.

    With all variances in proportion to the noise:  gain - Q/2 - E/2 ln(1 - Q/E). Of few poses the noise before is too
    large by what is missing, and the gains too small.
    """
    return gains - 0.5 * fit - 0.5 * mismatch * np.log1p(-np.minimum(fit / mismatch, 1.0 - 1e-12))


def best(s: Array, q: Array, cap: Array) -> tuple[Array, Array]:
    """Largest gain (G,) over variances up to cap² (G,), and where: a grid in log a, then golden section."""
    from gpmodel.evolution.kernels.variances import largest_gains

    s, q, top = np.maximum(s, 0.0), np.ascontiguousarray(q), 2.0 * np.log(cap)
    gains, where = np.empty(len(s)), np.empty(len(s))
    largest_gains(s, q, top, DECADES * np.log(10.0) / (GRID - 1), GRID, REFINEMENTS, gains, where)
    return gains, where


def rotated(inner: Array, rhs: Array) -> tuple[Array, Array]:
    """Eigenvalues s (G, K) of S (G, K, K) and q = Vᵀ rhs (G, K)."""
    if inner.shape[-1] == 1:
        return inner[:, :, 0], rhs
    s, turn = np.linalg.eigh(inner)
    return s, np.matmul(rhs[:, None, :], turn)[:, 0]
