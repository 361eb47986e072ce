"""Confidence intervals with estimated standard uncertainties, and p-values corrected for many tests."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.arrays import Array, IntArray

FREEDOMS = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 1000.0)
"""Degrees of freedom of alternative Student's t error distributions. The last one represents a normal distribution."""
NODES = 40
"""Number of normal distributions whose mixture approximates Student's t."""
STEPS = 100
SETTLED = 1e-3
"""Largest number of EM iterations for a scale of Student's t; relative change of the scale at which they end."""


@dataclass(frozen=True)
class Tails:
    """Student's t distributions of the errors of independent coordinates, weighted by their evidence.

    freedom: degrees of freedom of each distribution.
    scale: scale of each distribution, in the unit of the errors.
    weight: weight of each distribution; the weights sum to one.
    uncertain: relative standard error of each scale.
    evidence: logarithm of the mean likelihood over the degrees of freedom.
    """

    freedom: Array
    scale: Array
    weight: Array
    uncertain: Array
    evidence: float

    def drawn(self, shape: tuple[int, int, int], rng: np.random.Generator) -> Array:
        """Draw the measurement errors of simulated tables. shape: number of tables, and shape of the errors in a table.

        For each table a distribution is drawn by its weight, and its scale log-normally with deviation `uncertain`.
        """
        which = rng.choice(len(self.weight), shape[0], p=self.weight)
        scale = self.scale[which] * np.exp(self.uncertain[which] * rng.normal(size=shape[0]))
        out = rng.normal(size=shape)
        for k in np.unique(which):
            own = which == k
            if self.freedom[k] < FREEDOMS[-1]:
                squares = rng.chisquare(self.freedom[k], size=(int(own.sum()), *shape[1:]))
                out[own] /= np.sqrt(squares / self.freedom[k])
        return np.asarray(out * scale[:, None, None])


def tails(values: Array, count: float, blur: Array | float = 0.0) -> Tails:
    """Fit Student's t distributions to values with mean zero.

    For each number of degrees of freedom f in FREEDOMS the scale s of highest likelihood of the values is found.
    The variance of the scale s is s² (f + 3) / (2 f count).
    count: number of independent values to which the sample is equivalent.
    blur: variance that an error of the fitted parameters adds to each value, relative to the value's own variance.
    The added error is normal, as a sum of many terms.
    Student's t is computed as a mixture of normal distributions with variances s² u, u = f / χ²_f, at NODES quantiles
    of u. Scales by the EM iteration s² ← mean of Σ_u p(u | v) v² / (u + blur) (Lange, Little and Taylor 1989).
    """
    freedom, squares = np.array(FREEDOMS), np.square(values)[:, None, None]
    spread = freedom[:, None] / special.chdtri(freedom[:, None], 1.0 - (np.arange(NODES) + 0.5) / NODES)
    widths = spread + np.broadcast_to(blur, np.shape(values))[:, None, None] * spread.mean(axis=1)[:, None]
    variance = squares.mean() / spread.mean(axis=1)
    for _ in range(STEPS):
        densities = np.exp(-0.5 * squares / (widths * variance[:, None])) / np.sqrt(widths)
        each = densities.sum(axis=2) + np.finfo(float).tiny
        before, variance = variance, np.mean(np.sum(densities / widths, axis=2) / each * squares[:, :, 0], axis=0)
        if np.abs(variance / before - 1).max() < SETTLED:
            break
    likelihood = count * (np.log(each / NODES).mean(axis=0) - 0.5 * np.log(2 * np.pi * before))
    evidence = float(special.logsumexp(likelihood))
    uncertain = np.sqrt((freedom + 3) / (2 * freedom * count))
    return Tails(freedom, np.sqrt(variance), np.exp(likelihood - evidence), uncertain, evidence - np.log(len(freedom)))


def with_far_ones(
    inside: Array, far: Array, count: float, blurs: tuple[Array | float, Array | float] = (0.0, 0.0)
) -> Tails:
    """Fit error distributions to accepted errors and to outliers that a fit excluded.

    Two alternative models of errors are weighted by their evidence. Either one distribution explains all errors, or
    outliers are failures, uniform up to the largest error. Every rate of failures has an equal prior probability, so
    that F failures among F + M errors have the probability F! M! / (F + M + 1)!.
    inside, far: accepted errors and outliers, m.
    count: number of independent coordinates to which the accepted errors are equivalent.
    blurs: relative variances added to accepted errors and to outliers, as `blur` of `tails`.
    """
    own, other = (np.repeat(np.broadcast_to(b, len(v)), 3) for b, v in zip(blurs, (inside, far), strict=True))
    alone = tails(inside.ravel(), count, own)
    if not len(far):
        return alone
    every = np.concatenate([inside, far]).ravel(), count + 3 * len(far), np.concatenate([own, other])
    whole = tails(*every)
    volume = np.log(4.0 / 3.0 * np.pi) + 3.0 * np.log(float(np.linalg.norm(far, axis=1).max()))
    failed = special.betaln(len(far) + 1, len(inside) + 1) - len(far) * volume
    share = float(special.expit(whole.evidence - alone.evidence - failed))
    return _mixed(whole, alone, share, float(np.logaddexp(whole.evidence, alone.evidence + failed)))


def _mixed(one: Tails, other: Tails, share: float, evidence: float) -> Tails:
    """Combine two sets of distributions: `one` with probability `share`, `other` with 1 - `share`."""
    freedom, scale, uncertain = (
        np.concatenate([getattr(t, k) for t in (one, other)]) for k in ("freedom", "scale", "uncertain")
    )
    return Tails(
        freedom, scale, np.concatenate([share * one.weight, (1.0 - share) * other.weight]), uncertain, evidence
    )


COVERAGE = 0.95
"""Coverage probability of every reported confidence interval."""


def coverage_factor(freedom: float) -> float:
    """Return the factor k of an interval ± k σ of coverage COVERAGE, from Student's t.

    freedom: degrees of freedom of σ; infinite if σ is known. Source: JCGM 100 (2008), G.3.
    """
    return float(special.stdtrit(freedom, 0.5 * (1.0 + COVERAGE)))


def freedom_of_sum(deviations: Array, freedoms: Array) -> Array:
    """Return the effective degrees of freedom of √Σ u², summed along the first axis.

    For standard uncertainties u with ν degrees of freedom each: (Σ u²)² / Σ (u⁴ / ν). Source: Welch and Satterthwaite;
    JCGM 100 (2008), G.4.
    """
    squares = np.square(deviations)
    spread = np.sum(squares**2 / freedoms, axis=0)
    total = np.sum(squares, axis=0) ** 2
    return np.asarray(np.divide(total, spread, out=np.full(np.shape(total), np.inf), where=spread > 0))


SIGNIFICANCE = 0.01
"""Significance level of a test, after correction for the number of tests. The acceptance rule of findings has an equal
significance level."""


def holm(chances: Array) -> Array:
    """Correct p-values for the number of tests, whether or not the tests are independent.

    Of n p-values, sorted upwards as p_(1) to p_(n), p_(k) becomes max over j ≤ k of min(1, (n + 1 - j) p_(j)). Source:
    Holm (1979).
    """
    flat = chances.ravel()
    order = np.argsort(flat)
    out = np.empty_like(flat)
    out[order] = np.minimum(1.0, np.maximum.accumulate(np.arange(len(flat), 0, -1) * flat[order]))
    return out.reshape(chances.shape)


def chance_of_ratio(ratio: float, numbers: float, freedom: float) -> float:
    """Return the probability that a mean square is at least `ratio` times an estimated variance.

    The mean square is over `numbers` normal deviates; the variance has `freedom` degrees of freedom. The ratio is F
    distributed. If `freedom` is infinite the variance is known, and the ratio is χ² over its degrees of freedom.
    """
    return float(np.exp(log_chances_of_ratio(np.array(ratio), np.array(numbers), np.array(freedom))))


TINY = 1e-290
"""Probability below which the leading term of a tail replaces the tail: smaller ones soon have no number."""


def log_chances_of_ratio(ratios: Array, numbers: Array | IntArray, freedoms: Array) -> Array:
    """Return the logarithm of `chance_of_ratio` for each ratio, also of chances that are too small for a number.

    With x = ν / (ν + p r), the chance of a large ratio r of p deviates is nearly x^(ν/2) (1 - x)^(p/2 - 1) over
    ν/2 B(ν/2, p/2); of a known variance it is nearly (p r/2)^(p/2 - 1) e^(-p r/2) / Γ(p/2).
    Source: Abramowitz and Stegun (1964), 26.5.4 and 26.4.12.
    """
    known, half = np.isinf(freedoms), 0.5 * numbers
    freedoms = np.where(known, 1.0, freedoms)
    chances = np.where(known, special.chdtrc(numbers, ratios * numbers), special.fdtrc(numbers, freedoms, ratios))
    with np.errstate(divide="ignore"):
        found, share = np.log(chances), freedoms / (freedoms + ratios * numbers)
        beta = special.betaln(0.5 * freedoms, half) + np.log(0.5 * freedoms)
        tails = np.where(
            known,
            (half - 1.0) * np.log(half * ratios) - half * ratios - special.gammaln(half),
            0.5 * freedoms * np.log(share) + (half - 1.0) * np.log1p(-share) - beta,
        )
    return np.asarray(np.where(chances > TINY, found, tails))


def chance_of_less(ratio: float, numbers: float, freedom: float) -> float:
    """Return the probability that a mean square is at most `ratio` times an estimated variance. numbers, freedom: as in
    `chance_of_ratio`."""
    if np.isinf(freedom):
        return float(special.chdtr(numbers, ratio * numbers))
    return float(special.fdtr(numbers, freedom, ratio))
