"""How far out measurements lie: Student's t whose degrees of freedom, like its scale, are only as sure as a sample."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.arrays import Array

FREEDOMS = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 1000.0)
"""Degrees of freedom that are weighed against each other, all alike beforehand; the last is the normal distribution."""
STEPS = 200
SETTLED = 1e-8
"""Iterations of a scale at most; its relative change that ends them."""


@dataclass(frozen=True)
class Tails:
    """Of independent coordinates: by degrees of freedom (K,), scales (K,), weights (K,) that sum to one, and relative
    standard deviations of the scales (K,). evidence: logarithm of the mean likelihood over the freedoms."""

    freedom: Array
    scale: Array
    weight: Array
    uncertain: Array
    evidence: float

    def drawn(self, shape: tuple[int, int, int], rng: np.random.Generator) -> Array:
        """Errors (B, N, 3): in each of the B worlds one freedom and one scale, drawn by how sure they are."""
        which = rng.choice(len(self.weight), shape[0], p=self.weight)
        scale = self.scale[which] * np.exp(self.uncertain[which] * rng.normal(size=shape[0]))
        out = rng.normal(size=shape)
        for k in np.unique(which):
            own = which == k
            if self.freedom[k] < FREEDOMS[-1]:
                squares = rng.chisquare(self.freedom[k], size=(int(own.sum()), *shape[1:]))
                out[own] /= np.sqrt(squares / self.freedom[k])
        return np.asarray(out * scale[:, None, None])


def tails(values: Array, count: float) -> Tails:
    """Of a sample (M,) about zero that is worth `count` independent ones: likelihood over FREEDOMS, each with its best
    scale, whose variance is s² (f + 3) / (2 f count).

    Scales by the EM iteration s² ← mean (f + 1) v² / (f + v² / s²) (Lange, Little and Taylor 1989).
    """
    freedom = np.array(FREEDOMS)
    squares = np.square(values)
    variance = np.full(len(freedom), squares.mean())
    for _ in range(STEPS):
        before = variance
        variance = np.mean((freedom + 1) * squares[:, None] / (freedom + squares[:, None] / before), axis=0)
        if np.abs(variance / before - 1).max() < SETTLED:
            break
    constant = -0.5 * np.log(np.pi) + special.gammaln(0.5 * (freedom + 1)) - special.gammaln(0.5 * freedom)
    each = -0.5 * (freedom + 1) * np.log1p(squares[:, None] / (freedom * variance))
    likelihood = count * (constant - 0.5 * np.log(freedom * variance) + each.mean(axis=0))
    evidence = float(special.logsumexp(likelihood))
    uncertain = np.sqrt((freedom + 3) / (2 * freedom * count))
    return Tails(freedom, np.sqrt(variance), np.exp(likelihood - evidence), uncertain, evidence - np.log(len(freedom)))


def with_far_ones(inside: Array, far: Array, count: float) -> Tails:
    """Of errors (M, 3) and of those (F, 3) that a fit left out: of both where they are better explained as the tails of
    one distribution than as failures, which may lie anywhere as far away as the farthest.

    count: independent coordinates that the errors inside are worth.
    """
    alone = tails(inside.ravel(), count)
    if not len(far):
        return alone
    whole = tails(np.concatenate([inside, far]).ravel(), count + 3 * len(far))
    radius = float(np.linalg.norm(far, axis=1).max())
    rate = len(far) / (len(inside) + len(far))
    failed = len(far) * (np.log(rate) - np.log(4.0 / 3.0 * np.pi * radius**3)) + len(inside) * np.log1p(-rate)
    return whole if whole.evidence > alone.evidence + failed else alone
