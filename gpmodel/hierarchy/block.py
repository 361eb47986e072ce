"""Random effects of a block: effects with priors at one site, such as the harmonics of an error curve.

    b_i ~ N(μ, τ² P),  P = diag(prior²)                    b_i: the effects of machine i; P: their prior variances

Poses determine the effects together, hardly one by one. All effects are in units of their priors, so that P = 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from scipy import optimize, special

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.result import Calibration
from gpmodel.hierarchy.between import p_value_of
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
    """

    values: Array
    root: Array
    count: Array

    def subset(self, machines: Mask) -> "BlockInformation":
        """Return the information about some machines. machines: mask of the machines."""
        return BlockInformation(self.values[machines], self.root[machines], self.count[machines])


@dataclass(frozen=True)
class Common:
    """Mean of a block of effects over the machines, the covariance of the mean, and the spread τ between machines."""

    mean: Array
    covariance: Array
    spread: float


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


def block_spread(of: BlockInformation) -> tuple[float, float, float]:
    """Return τ of a block and its interval of coverage COVERAGE, as `estimate_spread` does for one parameter.

    At the estimated spread τ, Q(τ²) equals its expectation. At the ends of the interval Q is a quantile of χ² with m -
    1 degrees of freedom, as if all effects of a machine differed in one proportion.
    """
    tail, free = (1.0 - COVERAGE) / 2.0, len(of.values) - 1
    low, high = (_common(of, float(special.chdtri(free, q)) / free).spread for q in (tail, 1.0 - tail))
    return _common(of).spread, low, high


def deleted_distances(of: BlockInformation, inside: Mask) -> tuple[Array, Array]:
    """Return the distance of each machine from the others that are no outliers (`inside`), and its p-value."""
    distances, chance = np.empty(len(inside)), np.empty(len(inside))
    for i in range(len(inside)):
        others = inside & (np.arange(len(inside)) != i)
        type_ = _common(of.subset(others))
        spread = type_.covariance + type_.spread**2 * np.eye(len(type_.mean))
        distances[i], chance[i] = distance(of, i, type_.mean, spread, int(others.sum()))
    return distances, chance


def distance(of: BlockInformation, machine: int, mean: Array, covariance: Array, machines: int) -> tuple[float, float]:
    """Return the distance √(χ² / n) of a machine from a mean in n determined directions, and its p-value.

    covariance: covariance of the mean and the spread, estimated from `machines` others. Σ w_k χ²_k with Σ w_k =
    1 is large no more often than one χ² is (Székely and Bakirov 2003). The p-value of a single effect with an equal
    distance is therefore an upper bound, whichever effects differ.
    """
    root = of.root[machine]
    left = of.values[machine] - root @ mean
    square = float(left @ np.linalg.solve(np.eye(len(left)) + root @ covariance @ root.T, left))
    z = float(np.sqrt(square / max(int(of.count[machine]), 1)))
    return z, p_value_of(z, machines)


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


def _common(of: BlockInformation, share: float = 1.0) -> Common:
    """Estimate the mean and the spread of the machines.

    τ² solves Q = Σ r² / (1 + τ² λ) = `share` of its expectation; τ² is zero if Q is smaller at τ² = 0.
    """

    def excess(variance: float) -> float:
        _, _, square, expected = _weighed(of, variance)
        return square - share * expected

    variance, upper = 0.0, 1.0
    if excess(0.0) > 0.0:
        while excess(upper) > 0.0:
            upper *= 4.0
        variance = float(optimize.brentq(excess, 0.0, upper))
    mean, covariance, _, _ = _weighed(of, variance)
    return Common(mean, covariance, float(np.sqrt(variance)))


def _weighed(of: BlockInformation, variance: float) -> tuple[Array, Array, float, float]:
    """Return the mean μ with prior N(0, 1), its covariance, the sum of squares Q, and Q's expectation at a given τ².

    The expectation of Q is the number of determined directions minus the number that the mean absorbs.
    """
    weight = 1.0 / (1.0 + variance * np.sum(of.root**2, axis=2))
    weighed = weight[:, :, None] * of.root
    matrix = np.einsum("mki,mkj->ij", weighed, of.root)
    covariance = np.linalg.inv(np.eye(len(matrix)) + matrix)
    mean = covariance @ np.einsum("mki,mk->i", weighed, of.values)
    square = float(np.sum(weight * (of.values - of.root @ mean) ** 2))
    return mean, covariance, square, float(of.count.sum() - np.sum(covariance * matrix))
