"""Score candidate effects by their gain in description length, and groups of effects by their log evidence."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array
from gpmodel.evidence.residual import Residual
from gpmodel.evolution.description_length import fit_nats
from gpmodel.families.candidate import Candidate
from gpmodel.numerics import rank as ident

CHUNK = 256
"""Number of candidate effects projected at once; the number affects memory and no result."""
NOISE_STEPS = 5
"""Number of iterations that estimate the noise under a prior; a further iteration changes no printed digit."""


@dataclass(frozen=True)
class Score:
    """Score of a candidate effect.

    gain: share of the residual's sum of squares that the candidate removes.
    nats: gain in description length by the candidate, nats.
    share: smallest unique share of the candidate's columns.
    """

    gain: float
    nats: float
    share: float


def mdl_gain(residual: Residual, gain: float | Array, count: int, cost: float, inflation: float = 1.0) -> float | Array:
    """Compute the gain in description length, nats, of a candidate effect with `count` unknowns.

    dof/2 · (-ln(1 - gain)) / inflation - count/2 · ln M - cost; dof: degrees of freedom; M: rows (Rissanen 1978).
    """
    return fit_nats(gain, residual.freedom) / inflation - 0.5 * count * float(np.log(residual.measured)) - cost


def scores(residual: Residual, pool: Sequence[Candidate]) -> tuple[Score, ...]:
    """Score every candidate effect of a list. A candidate whose columns the model explains has no gain."""
    out: list[Score] = []
    for part in (pool[start : start + CHUNK] for start in range(0, len(pool), CHUNK)):
        left, shares = residual.projected([e for c in part for e in c.effects])
        ends = np.cumsum([len(c.effects) for c in part])[:-1]
        for candidate, span, own in zip(
            part, np.array_split(left, ends, axis=1), np.array_split(shares, ends), strict=True
        ):
            explained = own.max() < residual.criteria.scored_share
            gain, nats = (0.0, -np.inf) if explained else _gain(residual, candidate, span)
            out.append(Score(gain, nats, float(own.max() if explained else own.min())))
    return tuple(out)


def gains_by_inflation(residual: Residual, candidate: Candidate, inflations: Sequence[float]) -> list[float]:
    """Compute the gain of a candidate effect, nats, for each of some inflation factors of the noise variance."""
    if not inflations:
        return []
    span, _ = residual.projected(candidate.effects)
    return [_gain(residual, candidate, span, inflation)[1] for inflation in inflations]


def contribution(residual: Residual, candidate: Candidate) -> Array:
    """Compute the posterior mean of a candidate effect's contribution to each row of the residual, m."""
    span, _ = residual.projected(candidate.effects)
    if not candidate.has_priors:
        return np.asarray(span @ np.linalg.lstsq(span, residual.values, rcond=None)[0])
    u, s = directions(residual, candidate, span)
    along = u.T @ residual.values
    sigma2 = _noise(residual, s, along**2)
    return np.asarray(u @ (s**2 / (s**2 + sigma2) * along))


def unique_share(residual: Residual, candidate: Candidate) -> float:
    """Compute the share of a candidate's motion that the other effects of the model do not explain: |C⊥ w| / |C w|.

    C: columns of the candidate; for an instrument error without the part of registration and tool. C⊥: part of C that
    the model does not explain. w: smallest coefficients, in units of their priors if any, that give the candidate's
    contribution to the residual.
    """
    columns, size = residual.columns(candidate.effects), np.ones(len(candidate.effects))
    if candidate.has_priors:
        size = np.array([e.prior for e in candidate.effects])
    norms = np.linalg.norm(columns, axis=0) * size
    part = contribution(residual, candidate)
    left = residual.projected(candidate.effects)[0] * norms
    unknowns = np.linalg.lstsq(left, part, rcond=None)[0]
    moved = float(np.linalg.norm(columns * size @ unknowns))
    return float(np.linalg.norm(part[: residual.measured])) / moved if moved > 0.0 else 0.0


def _gain(residual: Residual, candidate: Candidate, span: Array, inflation: float = 1.0) -> tuple[float, float]:
    """Compute the share of the sum of squares that a candidate removes, and its gain in description length, nats."""
    if candidate.has_priors:
        u, s = directions(residual, candidate, span)
        parts = (u.T @ residual.values) ** 2
        sigma2 = inflation * _noise(residual, s, parts)
        gain = float(np.sum(s**2 / (s**2 + sigma2) * parts)) / residual.energy
        volume = 0.5 * float(np.sum(np.log1p(s**2 / sigma2)))
        return gain, float(fit_nats(gain, residual.freedom)) / inflation - volume - candidate.cost
    count = span.shape[1]
    q = ident.orthonormal(span) if count > 1 else span / np.linalg.norm(span, axis=0)
    gain = float(np.sum((q.T @ residual.values) ** 2)) / residual.energy
    return gain, float(mdl_gain(residual, gain, count, candidate.cost, inflation))


def directions(residual: Residual, candidate: Candidate, span: Array) -> tuple[Array, Array]:
    """Return U and s of the singular value decomposition U s Vᵀ of a candidate's columns times prior deviations."""
    norms = np.linalg.norm(residual.columns(candidate.effects), axis=0)
    prior = np.array([e.prior for e in candidate.effects])
    weighted = span * norms * prior
    squares, turn = linalg.eigh(weighted.T @ weighted)
    s = np.sqrt(np.maximum(squares, 1e-12 * squares[-1]))
    return weighted @ (turn / s), s


def _noise(residual: Residual, s: Array, parts: Array) -> float:
    """Estimate the noise variance by the marginal likelihood, for a candidate whose coefficients have priors.

    With singular vectors u and values s of the columns times priors, noise variance σ² and f = s² / (s² + σ²), the
    residual r keeps the sum of squares r·r - Σ f (u·r)². parts: squares of u·r. Source: MacKay (1992), evidence.
    """
    sigma2 = residual.energy / residual.freedom
    for _ in range(NOISE_STEPS):
        sigma2 = (residual.energy - float(np.sum(s**2 / (s**2 + sigma2) * parts))) / residual.freedom
    return sigma2


def fitted(variance: Array, s: Array, q: Array) -> Array:
    """Compute the misfit Σ a q² / (1 + a s) removed by each group: prior variance a, eigenvalues s, products q."""
    return np.asarray(np.sum(variance[:, None] * q**2 / (1.0 + variance[:, None] * np.maximum(s, 0.0)), axis=1))


def with_refitted_noise(gains: Array, fit: Array, mismatch: float) -> Array:
    """Correct the gains of groups of effects, nats, for the noise, which is estimated again with each group.

    fit: decrease Q of the misfit E by each group. With prior variances in proportion to the noise the gain is gain -
    Q/2 - E/2 ln(1 - Q/E). With few poses the noise without the group is too large, and the first gain too small.
    """
    return gains - 0.5 * fit - 0.5 * mismatch * np.log1p(-np.minimum(fit / mismatch, 1.0 - 1e-12))


def diagonalised(inner: Array, rhs: Array) -> tuple[Array, Array]:
    """Compute the eigenvalues of each group's symmetric matrix, and the products of its eigenvectors with `rhs`."""
    if inner.shape[-1] == 1:
        return inner[:, :, 0], rhs
    s, turn = np.linalg.eigh(inner)
    return s, np.matmul(rhs[:, None, :], turn)[:, 0]
