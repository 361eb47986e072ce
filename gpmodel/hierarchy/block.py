"""Random effects of a block: effects that come with priors and act in one place, as the harmonics of an error curve.

    b_i ~ N(μ, τ² P),  P = diag(prior²)                    b_i: the effects of machine i; P: what their priors expect

Poses tell such effects together, hardly one by one. Everything here is in units of the priors, where P is 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from scipy import optimize, special

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.result import Calibration
from gpmodel.hierarchy.between import chance_of
from gpmodel.model.effect import Effect
from gpmodel.numerics.interval import COVERAGE

TOLD = 1.0
"""Information of the poses on a direction, over that of the prior, from which the direction is tested. Others would
dilute the test."""


@dataclass(frozen=True)
class BlockInformation:
    """Information of poses about a block of effects.

    values: (m, E) with unit variance.
    root: (m, E, E) factor of the information, zero in directions that the poses do not determine.
    count: (m,) number of determined directions.
    """

    values: Array
    root: Array
    count: Array

    def subset(self, machines: Mask) -> "BlockInformation":
        """Return the information of some machines (m,)."""
        return BlockInformation(self.values[machines], self.root[machines], self.count[machines])


@dataclass(frozen=True)
class Common:
    """Mean (E,) of the machines, its covariance (E, E), and τ."""

    mean: Array
    covariance: Array
    spread: float


def blocks(effects: Sequence[Effect]) -> list[tuple[str, tuple[Effect, ...]]]:
    """Effects with priors in blocks, each with its name: of one family at the same slots, what has no family alone."""
    groups: dict[object, list[Effect]] = {}
    for effect in effects:
        if np.isfinite(effect.prior):
            groups.setdefault((effect.family, effect.slots) if effect.family else effect.name, []).append(effect)
    return [(_alike([e.name for e in group]), tuple(group)) for group in groups.values()]


def _alike(names: list[str]) -> str:
    """Return the common beginning of names up to a comma; the first name without one."""
    parts = [name.split(", ") for name in names]
    same = takewhile(lambda at: len(set(at)) == 1, zip(*parts, strict=False))
    return ", ".join(at[0] for at in same) or names[0]


def block_information(fits: Sequence[Calibration], effects: tuple[Effect, ...]) -> BlockInformation:
    """Compute the information of fits about a block of effects, given priors and known noise: Λ = C⁻¹ - 1 and Λ b̂ =
    C⁻¹ θ of each, Λ = Rᵀ R.
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


def shared(of: BlockInformation) -> tuple[float, float, float]:
    """τ and its interval of COVERAGE coverage, as `between` has them: Q(τ²) is as large as expected, and its quantiles
    those of χ² with m - 1 degrees of freedom, as if all effects of a machine differed in one proportion."""
    tail, free = (1.0 - COVERAGE) / 2.0, len(of.values) - 1
    low, high = (_common(of, float(special.chdtri(free, q)) / free).spread for q in (tail, 1.0 - tail))
    return _common(of).spread, low, high


def deleted(of: BlockInformation, inside: Mask) -> tuple[Array, Array]:
    """Distance (m,) of each machine from the others `inside`, and its chance."""
    distances, chance = np.empty(len(inside)), np.empty(len(inside))
    for i in range(len(inside)):
        others = inside & (np.arange(len(inside)) != i)
        type_ = _common(of.subset(others))
        spread = type_.covariance + type_.spread**2 * np.eye(len(type_.mean))
        distances[i], chance[i] = distance(of, i, type_.mean, spread, int(others.sum()))
    return distances, chance


def distance(of: BlockInformation, machine: int, mean: Array, covariance: Array, machines: int) -> tuple[float, float]:
    """√(χ² / n) of a machine's n told directions about a mean (E,) with a covariance (E, E) known from `machines`
    others, and its chance.

    Σ w_k χ²_k with Σ w_k = 1 is large no more often than one χ² is (Székely and Bakirov 2003): the chance is that of
    one effect so far out, whatever effects of a block differ between machines.
    """
    root = of.root[machine]
    left = of.values[machine] - root @ mean
    square = float(left @ np.linalg.solve(np.eye(len(left)) + root @ covariance @ root.T, left))
    z = float(np.sqrt(square / max(int(of.count[machine]), 1)))
    return z, chance_of(z, machines)


def further_distance(
    fit: Calibration, effects: tuple[Effect, ...], believed: tuple[Effect, ...], machines: int
) -> tuple[float, float]:
    """Return the distance of a machine fitted alone from the prior of its type.

    believed: the same effects with the prior learned from `machines` machines.
    """
    own, mean, deviation = (
        np.array([getattr(e, k) for e in of]) for of, k in ((effects, "prior"), (believed, "mean"), (believed, "prior"))
    )
    centre = (mean - np.array([e.mean for e in effects])) / own
    return distance(block_information([fit], effects), 0, centre, np.diag((deviation / own) ** 2), machines)


def _common(of: BlockInformation, share: float = 1.0) -> Common:
    """Estimate what machines have in common.

    τ² solves Q = Σ r² / (1 + τ² λ) = `share` of its expectation; it is zero if Q is below that at τ² = 0.
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
    """Mean beside μ ~ N(0, 1), its covariance, Q, and Q's expectation: told directions less those the mean takes."""
    weight = 1.0 / (1.0 + variance * np.sum(of.root**2, axis=2))
    weighed = weight[:, :, None] * of.root
    matrix = np.einsum("mki,mkj->ij", weighed, of.root)
    covariance = np.linalg.inv(np.eye(len(matrix)) + matrix)
    mean = covariance @ np.einsum("mki,mk->i", weighed, of.values)
    square = float(np.sum(weight * (of.values - of.root @ mean) ** 2))
    return mean, covariance, square, float(of.count.sum() - np.sum(covariance * matrix))
