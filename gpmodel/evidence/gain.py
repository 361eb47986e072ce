"""What a group is worth by marginal likelihood, as a function of its variance, for very many groups at once.

With C the covariance of what is in the model without the group, S = XᵀC⁻¹X = V diag(s) Vᵀ and q = VᵀXᵀC⁻¹y:

    gain(a) = ½ Σ_i [ a q_i² / (1 + a s_i) - ln(1 + a s_i) ]        nats

Source: Tipping and Faul (2003), for groups of columns in place of single ones.
"""

import numpy as np

from gpmodel.arrays import Array

DECADES = 10.0
GRID = 24
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
REFINEMENTS = 12
"""The variance is sought over so many powers of ten below the largest; at so many places; the ratio of a golden
section; so many of them between the best two places, to a hundredth of a nat."""


def gain(variance: Array, s: Array, q: Array) -> Array:
    """Gain (G, T) of G groups at T variances (G, T); s, q: (G, K)."""
    load = variance[:, :, None] * s[:, None, :]
    return np.asarray(0.5 * np.sum(variance[:, :, None] * q[:, None, :] ** 2 / (1.0 + load) - np.log1p(load), axis=2))


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
    s = np.maximum(s, 0.0)
    top = 2.0 * np.log(cap)
    step = DECADES * np.log(10.0) / (GRID - 1)
    grid = top[:, None] - step * np.arange(GRID)[::-1][None, :]
    at = np.argmax(gain(np.exp(grid), s, q), axis=1)
    middle = grid[np.arange(len(grid)), at]
    low, high = middle - step, np.minimum(middle + step, top)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = (gain(np.exp(x)[:, None], s, q)[:, 0] for x in (left, right))
    for _ in range(REFINEMENTS):
        lower = at_left > at_right
        low, high = np.where(lower, low, left), np.where(lower, right, high)
        new = np.where(lower, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        value = gain(np.exp(new)[:, None], s, q)[:, 0]
        left, right = np.where(lower, new, right), np.where(lower, left, new)
        at_left, at_right = np.where(lower, value, at_right), np.where(lower, at_left, value)
    where = np.where(at_left > at_right, left, right)
    return np.maximum(at_left, at_right), np.exp(where)


def rotated(inner: Array, rhs: Array) -> tuple[Array, Array]:
    """Eigenvalues s (G, K) of S (G, K, K) and q = Vᵀ rhs (G, K)."""
    if inner.shape[-1] == 1:
        return inner[:, :, 0], rhs
    s, turn = np.linalg.eigh(inner)
    return s, np.matmul(rhs[:, None, :], turn)[:, 0]
