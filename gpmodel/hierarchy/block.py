"""Random effects of a block: effects with priors at one site, such as the harmonics of an error curve.

    b_i ~ N(μ, τ² P),  P = diag(prior²)                    b_i: the effects of machine i; P: their prior variances

Poses determine the effects together, hardly one by one. All effects are in units of their priors, so that P = 1. A
parameter without a prior is a block of one effect in its own unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
from scipy import optimize, special

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.result import Calibration
from gpmodel.model.effect import Effect
from gpmodel.numerics.interval import COVERAGE

TOLD = 1.0
"""Least ratio of the information of the poses to that of the prior in a direction for the direction to be tested.
Directions (effect combinations) with a smaller ratio would dilute the test."""


@dataclass(frozen=True)
class BlockInformation:
    """Information of the poses of m machines about a block of E effects.

    values: estimates of the effects with unit variance.
    root: factor of the information, zero in directions that the poses do not determine.
    count: number of directions that the poses determine.
    prior: precision of the prior of the mean over the machines.
    """

    values: Array
    root: Array
    count: Array
    prior: float = 1.0

    def subset(self, machines: Mask) -> "BlockInformation":
        """Return the information about some machines. machines: mask of the machines."""
        return replace(self, values=self.values[machines], root=self.root[machines], count=self.count[machines])


@dataclass(frozen=True)
class TypeDistribution:
    """Distribution of a block of effects between machines.

    mean, covariance: mean of the effects over the machines of the type, and the covariance of this mean.
    spread: standard deviation τ between machines.
    low, high: interval of τ with coverage COVERAGE.
    """

    mean: Array
    covariance: Array
    spread: float
    low: float
    high: float


def blocks(effects: Sequence[Effect]) -> list[tuple[str, tuple[Effect, ...]]]:
    """Group effects with priors into named blocks: one block for each family and set of frames.

    An effect without a family is a block of its own.
    """
    groups: dict[object, list[Effect]] = {}
    for effect in effects:
        if np.isfinite(effect.prior):
            groups.setdefault((effect.family, effect.slots) if effect.family else effect.name, []).append(effect)
    return [(_alike([e.name for e in group]), tuple(group)) for group in groups.values()]


def _alike(names: list[str]) -> str:
    """Return the common beginning of effects' names up to a comma, or the first name without a common beginning."""
    parts = [name.split(", ") for name in names]
    same = takewhile(lambda at: len(set(at)) == 1, zip(*parts, strict=False))
    return ", ".join(at[0] for at in same) or names[0]


def block_information(fits: Sequence[Calibration], effects: tuple[Effect, ...]) -> BlockInformation:
    """Compute the Fisher information of each machine's fit about a block of effects, given their priors and the noise.

    With the covariance C and the values θ of the fitted effects, the information is Λ = C⁻¹ - 1 = RᵀR and the estimates
    b̂ solve Λ b̂ = C⁻¹ θ.
    """
    values, roots = [], []
    prior, mean = (np.array([getattr(e, k) for e in effects]) for k in ("prior", "mean"))
    for fit in fits:
        names = [e.name for e in fit.model.effects]
        at = np.array([names.index(e.name) for e in effects])
        place = len(fit.covariance.placement) + at
        inverse = np.linalg.inv(fit.covariance.values[np.ix_(place, place)] / np.outer(prior, prior))
        information, directions = np.linalg.eigh(0.5 * (inverse + inverse.T) - np.eye(len(at)))
        size = np.sqrt(np.where(information > TOLD, information, 0.0))
        seen = directions.T @ inverse @ ((fit.theta[at] - mean) / prior)
        values.append(np.divide(seen, size, out=np.zeros(len(at)), where=size > 0))
        roots.append(size[:, None] * directions.T)
    root = np.array(roots)
    return BlockInformation(np.array(values), root, np.sum(root.any(axis=2), axis=1))


def parameter_information(values: Array, stderr: Array) -> BlockInformation:
    """Return the information of the poses of m machines about a parameter without a prior, from its estimates."""
    root = 1.0 / stderr
    return BlockInformation((values * root)[:, None], root[:, None, None], np.ones(len(root), dtype=int), 0.0)


def type_distribution(of: BlockInformation) -> TypeDistribution:
    """Estimate mean and spread of a block over m ≥ 2 machines.

    At the estimated spread τ, Q(τ²) equals its expectation. At the ends of the interval Q is a quantile of χ² with m -
    1 degrees of freedom (Viechtbauer 2007), in a block as if all effects of a machine differed in one proportion.
    """
    tail, free = (1.0 - COVERAGE) / 2.0, len(of.values) - 1
    low, high = (_common(of, float(special.chdtri(free, q)) / free)[2] for q in (tail, 1.0 - tail))
    return TypeDistribution(*_common(of), low, high)


def deleted_distances(of: BlockInformation, inside: Mask) -> tuple[Array, Array]:
    """Return the distance of each machine from the others that are no outliers (`inside`), and its p-value.

    Source: Viechtbauer and Cheung (2010); Higgins et al. (2009).
    """
    distances, chance = np.empty(len(inside)), np.empty(len(inside))
    for i in range(len(inside)):
        others = inside & (np.arange(len(inside)) != i)
        mean, covariance, spread = _common(of.subset(others))
        covariance = covariance + spread**2 * np.eye(len(mean))
        distances[i], chance[i] = distance(of, i, mean, covariance, int(others.sum()))
    return distances, chance


def distance(of: BlockInformation, machine: int, mean: Array, covariance: Array, machines: int) -> tuple[float, float]:
    """Return the distance √(χ² / n) of a machine from a mean in n determined directions, and its p-value.

    The distance of a single effect has the sign of its deviation.
    covariance: covariance of the mean and the spread, estimated from `machines` others: a single effect's distance has
    Student's t distribution with `machines` - 1 degrees of freedom. Σ w_k χ²_k with Σ w_k = 1 is large no more often
    than one χ² is (Székely and Bakirov 2003). The p-value of a single effect with an equal distance is therefore an
    upper bound, whichever effects differ.
    """
    root = of.root[machine]
    left = of.values[machine] - root @ mean
    square = float(left @ np.linalg.solve(np.eye(len(left)) + root @ covariance @ root.T, left))
    z = float(np.sqrt(square / max(int(of.count[machine]), 1)))
    return z if len(left) > 1 else float(np.copysign(z, left[0])), 2.0 * float(special.stdtr(machines - 1, -z))


def further_distance(
    fit: Calibration, effects: tuple[Effect, ...], learned: tuple[Effect, ...], machines: int
) -> tuple[float, float]:
    """Return the distance of a machine fitted alone from the prior of its type, and its p-value.

    learned: effects with the prior learned from `machines` machines.
    """
    own, mean, deviation = (
        np.array([getattr(e, k) for e in of]) for of, k in ((effects, "prior"), (learned, "mean"), (learned, "prior"))
    )
    centre = (mean - np.array([e.mean for e in effects])) / own
    return distance(block_information([fit], effects), 0, centre, np.diag((deviation / own) ** 2), machines)


def _common(of: BlockInformation, share: float = 1.0) -> tuple[Array, Array, float]:
    """Estimate the mean of the machines, its covariance, and the spread τ between machines.

    τ² solves Q = Σ r² / (1 + τ² λ) = `share` of its expectation (Paule and Mandel 1982; DerSimonian and Kacker 2007);
    τ² is zero if Q is smaller at τ² = 0.
    """

    def excess(variance: float) -> float:
        _, _, square, expected = _weighed(of, variance)
        return square - share * expected

    variance = 0.0
    if excess(0.0) > 0.0:
        upper = float(of.count.sum() / np.sum(of.root**2))
        while excess(upper) > 0.0:
            upper *= 4.0
        variance = upper * float(optimize.brentq(lambda part: excess(part * upper), 0.0, 1.0))
    mean, covariance, _, _ = _weighed(of, variance)
    return mean, covariance, float(np.sqrt(variance))


def _weighed(of: BlockInformation, variance: float) -> tuple[Array, Array, float, float]:
    """Return the mean μ with its prior, its covariance, the sum of squares Q, and Q's expectation at a given τ².

    The expectation of Q is the number of determined directions minus the number that the mean absorbs.
    """
    weight = 1.0 / (1.0 + variance * np.sum(of.root**2, axis=2))
    weighed = weight[:, :, None] * of.root
    matrix = np.einsum("mki,mkj->ij", weighed, of.root)
    covariance = np.linalg.inv(of.prior * np.eye(len(matrix)) + matrix)
    mean = covariance @ np.einsum("mki,mk->i", weighed, of.values)
    square = float(np.sum(weight * (of.values - of.root @ mean) ** 2))
    return mean, covariance, square, float(of.count.sum() - np.sum(covariance * matrix))
