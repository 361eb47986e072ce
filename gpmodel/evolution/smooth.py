"""Smooth functions at a place without a shape: of one input, of several as factors, and of two as summands, of their
weighted sum and of a distance.

A function φ is a sum of ``Sines`` of the most likely variance. With D, B, g of
``projection.Targets`` at their first site, Φ (N, m) the sines, σ² the noise:

    a = (Φᵀ(D - BᵀB)Φ + σ²/τ I)⁻¹ Φᵀg,    φ = Φa

Source: Breiman and Friedman (1985) for factors in turn; Friedman and Stuetzle (1981) for functions of weighted sums.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from gpmodel.arrays import Array
from gpmodel.evolution.projection import Targets


@dataclass(frozen=True)
class Sines:
    """The sines of one input. values: (N, m) times their deviations. rates: rad per unit; start: where they are 0."""

    name: str
    values: Array
    rates: Array
    start: float
    spreads: Array

    @staticmethod
    def of(name: str, column: Array, length: float) -> "Sines":
        """The sines of a column (N,) for a correlation length over half its range."""
        half, reach = 0.5 * float(np.ptp(column)), max(1.5, 3.2 * length)
        omega = np.pi * np.arange(1, math.ceil(1.75 * reach / length) + 1) / (2.0 * reach)
        start = float(column.min()) - (reach - 1.0) * half
        spreads = np.exp(-((length * omega) ** 2) / 4.0)
        rates = np.array([float(f"{w / half:.6g}") for w in omega])
        start = float(f"{start:.12g}")  # clocks count from far away
        return Sines(name, np.sin(np.outer(column - start, rates)) * spreads, rates, start, spreads)

    def text(self, k: int) -> str:
        """Sine k as an expression."""
        return f"sin({float(self.rates[k])!r}*({self.name} - ({self.start!r})))"


LENGTH = 0.35
"""Correlation length over half the range of an input: of a bump of a fifth of the range."""
LIKELIEST = 20
"""Steps of expectation and maximisation to the most likely variance."""
TURNS, STARTS = 15, 3
"""Turns of each factor; first guesses at each but the first, its slowest sines."""
DIRECTIONS, ANGLE = 24, 0.01
"""Directions of a weighted sum that are tried, evenly over half a turn, and how near the best is found, rad."""
POINTS = (-1.2, -0.6, 0.0, 0.6, 1.2)
"""Where a distance is first counted from, in standard deviations of each input about its mean."""
NEAR = ((-3.0, 3.0), (-3.0, 3.0), (-1.5, 1.5))
"""How far the point may be, in these, and how unequal the inputs' deviations may count, as a logarithm."""
LEAST = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Smooth:
    """A function at a place: coefficients (m,) of its sines, nats that it saves, the noise variance that it leaves."""

    coefficients: Array
    nats: float
    noise: float


def smooth(targets: Targets, basis: Array, noise: float) -> Smooth:
    """The most likely function in the span of a basis (N, m), of which the variance of the noise is known."""
    seen = targets.cross[0] @ basis
    sizes, turn = np.linalg.eigh(basis.T @ (targets.weight[0][:, None] * basis) - seen.T @ seen)
    sizes, pull = np.maximum(sizes, 0.0), turn.T @ (basis.T @ targets.pull[0])
    variance = noise * len(sizes) / max(float(sizes.sum()), LEAST)
    for _ in range(LIKELIEST):
        spread = noise * variance / (noise + variance * sizes)
        variance = float(np.mean((spread * pull / noise) ** 2 + spread))
    mean = variance * pull / (noise + variance * sizes)
    nats = 0.5 * float(np.sum(mean * pull / noise - np.log1p(variance * sizes / noise)))
    determined = float(np.sum(variance * sizes / (noise + variance * sizes)))
    left = targets.energy - 2.0 * float(mean @ pull) + float(mean**2 @ sizes)
    return Smooth(turn @ mean, nats, max(left, LEAST) / max(targets.components - determined, 1.0))


def factors(targets: Targets, columns: Array) -> tuple[float, Array]:
    """The noise variance that a product leaves, and its factors: functions (K, N) of each of K columns (K, N), of mean
    square 1, whose product leaves least noise, by turns."""
    bases = [Sines.of("", column, LENGTH).values for column in columns]
    starts = itertools.product(*(basis.T[:STARTS] for basis in bases[1:]))
    return min((_in_turn(targets, bases, start) for start in starts), key=lambda found: found[0])


def _in_turn(targets: Targets, bases: Sequence[Array], start: Sequence[Array]) -> tuple[float, Array]:
    """The noise variance that a product leaves, and its factors, from a first guess at all (N,) but the first."""
    noise, values = targets.energy / targets.components, np.array([np.ones(len(start[0])), *start])
    for _ in range(TURNS):
        for k, basis in enumerate(bases):
            found = smooth(targets, basis * others(values, k)[:, None], noise)
            values[k] = _unit(basis @ found.coefficients)
        noise = found.noise
    return noise, values


def others(values: Array, k: int) -> Array:
    """The product (N,) of factors (K, N) but number k."""
    return np.asarray(np.prod(np.delete(values, k, axis=0), axis=0))


def _unit(values: Array) -> Array:
    """Values (N,) over the root of their mean square."""
    return np.asarray(values / max(float(np.sqrt(np.mean(values**2))), LEAST))


def through(targets: Targets, factor: Array) -> Targets:
    """The targets of what a factor (N,) is multiplied with: what one pose says of it grows with this one."""
    return replace(targets, weight=targets.weight * factor**2, cross=targets.cross * factor, pull=targets.pull * factor)


def summands(targets: Targets, columns: Array) -> tuple[Array, Array]:
    """Functions (N,) of each of two columns (2, N) whose sum is most likely."""
    first, second = (Sines.of("", column, LENGTH).values for column in columns)
    found = _settled(targets, np.hstack([first, second]))
    one, other = np.split(found.coefficients, [first.shape[1]])
    return first @ one, second @ other


def _settled(targets: Targets, basis: Array) -> Smooth:
    """The most likely function in the span of a basis (N, m), of the noise that it leaves itself."""
    noise = targets.energy / targets.components
    for _ in range(TURNS):
        found = smooth(targets, basis, noise)
        noise = found.noise
    return found


def noise_left(targets: Targets, column: Array) -> float:
    """The noise variance that the most likely function of a column (N,) leaves at a place."""
    return _settled(targets, Sines.of("", column, LENGTH).values).noise


def without(targets: Targets, values: Array) -> Targets:
    """The targets once a function (N,) at their first site is taken off the residual."""
    seen = targets.cross[0] @ values
    column = targets.weight[0] * values - seen @ targets.cross[0]
    left = targets.energy - 2.0 * float(targets.pull[0] @ values) + float(column @ values)
    return replace(targets, pull=targets.pull - column, energy=max(left, LEAST))


def weighted_sum(targets: Targets, columns: Array) -> tuple[float, float]:
    """Weights of two columns (2, N) in the sum of which a function saves most."""
    spread, noise = columns.std(axis=1), targets.energy / targets.components

    def weights(angle: float) -> Array:
        return np.asarray(np.array([np.cos(angle), np.sin(angle)]) / spread)

    def cost(angle: float) -> float:
        return -smooth(targets, Sines.of("", weights(angle) @ columns, LENGTH).values, noise).nats

    step = np.pi / DIRECTIONS
    best = min((step * k for k in range(DIRECTIONS)), key=cost)
    found = minimize_scalar(cost, bounds=(best - step, best + step), method="bounded", options={"xatol": ANGLE})
    first, second = weights(float(found.x)).tolist()
    return first, second


def distance(targets: Targets, columns: Array) -> tuple[float, float, float]:
    """A point in the plane of two columns (2, N), the distance from which says most, and how often the second counts.

    (a, b, w) of √((x - a)² + w² (y - b)²).
    """
    middle, spread = columns.mean(axis=1), columns.std(axis=1)
    scaled, noise = (columns - middle[:, None]) / spread[:, None], targets.energy / targets.components

    def cost(point: Array) -> float:
        away = np.hypot(scaled[0] - point[0], np.exp(point[2]) * (scaled[1] - point[1]))
        return -smooth(targets, Sines.of("", away, LENGTH).values, noise).nats

    starts = sorted((np.array([a, b, 0.0]) for a in POINTS for b in POINTS), key=cost)[:STARTS]
    ends = (minimize(cost, start, method="Nelder-Mead", bounds=NEAR) for start in starts)
    found = min(ends, key=lambda end: float(end.fun))
    (a, b), log_ratio = middle + spread * found.x[:2], float(found.x[2])
    return float(a), float(b), float(np.exp(log_ratio) * spread[0] / spread[1])
