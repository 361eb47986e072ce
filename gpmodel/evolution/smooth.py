"""Smooth functions at a place without a shape: of one input, of several as factors, and of two as summands, of a
product and a summand, of their weighted sum and of a distance.

A function φ is a sum of ``Sines`` of the most likely variance. With D, B, g of
``projection.Targets`` at their first site, Φ (N, m) the sines, σ² the noise:

    a = (Φᵀ(D - BᵀB)Φ + σ²/τ I)⁻¹ Φᵀg,    φ = Φa

Source: Breiman and Friedman (1985) for factors in turn; Friedman and Stuetzle (1981) for functions of weighted sums.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from gpmodel.arrays import Array
from gpmodel.evolution.projection import Targets
from gpmodel.evolution.variances import best


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
BEYOND = 100.0
"""Largest prior variance that is tried, over the one at which a function would be the whole residual."""
SETTLED = 1e-4
"""Relative change of the noise below which turns end."""
TURNS, KEPT = (3, 15), 4
"""Turns of each factor from every first guess, and from the best ones, so many."""
STARTS = {1: 1, 2: 8, 3: 5, 4: 3}
"""First guesses at each factor but the first, its slowest sines, by the number of factors: of two, all of them."""
PARTS_IN_TURN = 3
"""Turns of a product and a summand; a fourth moves neither by a tenth of the noise."""
DIRECTIONS, MOST = {2: 13, 3: 7, 4: 4}, 2.0
"""Weights from -1 to 1 of each input of a sum but one that are tried, by the number of inputs; the largest weight."""
FINE = {"xatol": 0.01, "fatol": 0.01, "maxfev": 120}
"""Tolerances of the best weights."""
POINTS, NEAREST = (-1.2, -0.6, 0.0, 0.6, 1.2), 3
"""Where a distance is first counted from, in standard deviations of each input about its mean; the best, so many."""
NEAR = ((-3.0, 3.0), (-3.0, 3.0), (-1.5, 1.5))
"""Bounds of the point, and of the logarithm of the ratio of the inputs' scales."""
LEAST = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Smooth:
    """A function at a place: coefficients (m,) of its sines, nats that it saves, the noise variance that it leaves."""

    coefficients: Array
    nats: float
    noise: float


def smooth(targets: Targets, basis: Array, noise: float, turns: int = 1) -> Smooth:
    """The most likely function in the span of a basis (N, m) at a variance of the noise, which of several turns each
    takes over from the one before."""
    axes = _axes(targets, basis[None])
    for _ in range(turns):
        found = _most_likely(targets, axes, np.array([noise]))
        before, noise = noise, float(found[2][0])
        if abs(noise - before) < SETTLED * before:
            break
    return Smooth(found[0][0], float(found[1][0]), noise)


_Axes = tuple[Array, Array, Array]
"""Eigenvalues (S, m) and eigenvectors (S, m, m) of Φᵀ(D - BᵀB)Φ of several bases, and Φᵀg (S, m) along these."""


def _axes(targets: Targets, basis: Array) -> _Axes:
    """Diagonalise the products of bases (S, N, m)."""
    weighted, seen = basis * targets.weight[0][:, None], targets.cross[0] @ basis
    sizes, turn = np.linalg.eigh(np.swapaxes(basis, 1, 2) @ weighted - np.swapaxes(seen, 1, 2) @ seen)
    return np.maximum(sizes, 0.0), turn, np.matmul((targets.pull[0] @ basis)[:, None, :], turn)[:, 0]


def _most_likely(targets: Targets, axes: _Axes, noise: Array) -> tuple[Array, Array, Array]:
    """Coefficients (S, m) of the most likely function in the span of each basis at a variance of the noise (S,), the
    nats (S,) that it saves, and the noise (S,) that it leaves."""
    sizes, turn, along = axes
    s, q = sizes / noise[:, None], along / noise[:, None]
    total = np.maximum(sizes.sum(axis=1), LEAST)
    nats, variance = best(s, q, np.sqrt(BEYOND * targets.energy / total))
    load = variance[:, None] * s
    mean = variance[:, None] * q / (1.0 + load)
    rest = targets.energy + np.sum(mean * (mean * sizes - 2.0 * along), axis=1)
    freedom = np.maximum(targets.components - np.sum(load / (1.0 + load), axis=1), 1.0)
    return np.matmul(turn, mean[:, :, None])[:, :, 0], nats, np.maximum(rest, LEAST) / freedom


def factors(targets: Targets, columns: Array) -> tuple[float, Array]:
    """The noise variance that a product leaves, and its factors: functions (K, N) of each of K columns (K, N), of mean
    square 1, whose product leaves least noise, by turns from many first guesses at all but the first."""
    bases = np.array([Sines.of("", column, LENGTH).values for column in columns])
    slowest = STARTS[min(len(columns), max(STARTS))]
    starts = np.array(list(itertools.product(range(slowest), repeat=len(columns) - 1)), dtype=np.int64)
    begun = np.ones((len(starts), *columns.shape))
    for k in range(1, len(columns)):
        begun[:, k] = bases[k].T[starts[:, k - 1]]
    noise = _in_turn(targets, bases, begun, TURNS[0])
    begun = begun[np.argsort(noise, kind="stable")[:KEPT]]
    noise = _in_turn(targets, bases, begun, TURNS[1])
    return float(noise.min()), begun[int(np.argmin(noise))]


def _in_turn(targets: Targets, bases: Array, values: Array, turns: int) -> Array:
    """Improve products (S, K, N) of functions of bases (K, N, m), one factor after the other, in place; the noise (S,)
    that they leave."""
    noise = np.full(len(values), targets.energy / targets.components)
    for _ in range(turns):
        before = noise
        for k, basis in enumerate(bases):
            beside = np.prod(np.delete(values, k, axis=1), axis=1)
            coefficients, _, left = _most_likely(targets, _axes(targets, basis * beside[:, :, None]), noise)
            value = coefficients @ basis.T
            size = np.sqrt(np.mean(value**2, axis=1, keepdims=True))
            values[:, k] = value / np.maximum(size, LEAST)
        noise = left
        if (np.abs(noise - before) < SETTLED * before).all():
            break
    return noise


def others(values: Array, k: int) -> Array:
    """The product (N,) of factors (K, N) but number k."""
    return np.asarray(np.prod(np.delete(values, k, axis=0), axis=0))


def through(targets: Targets, factor: Array) -> Targets:
    """The targets of what a factor (N,) is multiplied with: what one pose says of it grows with this one."""
    return replace(targets, weight=targets.weight * factor**2, cross=targets.cross * factor, pull=targets.pull * factor)


def summands(targets: Targets, columns: Array) -> tuple[Array, Array]:
    """Functions (N,) of each of two columns (2, N) whose sum is most likely."""
    first, second = (Sines.of("", column, LENGTH).values for column in columns)
    found = _settled(targets, np.hstack([first, second]))
    one, other = np.split(found.coefficients, [first.shape[1]])
    return first @ one, second @ other


def product_and_summand(targets: Targets, columns: Array) -> tuple[float, Array, Array]:
    """The noise variance that a sum leaves, and its parts (N,): a product of functions of each of K columns (K, N) but
    the last, and a function of the last, each in turn with the other taken off the residual."""
    basis = Sines.of("", columns[-1], LENGTH).values
    summand = basis @ _settled(targets, basis).coefficients
    for _ in range(PARTS_IN_TURN):
        seen = without(targets, summand)
        product = np.prod(factors(seen, columns[:-1])[1], axis=0)
        product = product * seen.set_gain(product[None], 0)[1][0]
        found = _settled(without(targets, product), basis)
        summand = basis @ found.coefficients
    return found.noise, product, summand


def _settled(targets: Targets, basis: Array) -> Smooth:
    """The most likely function in the span of a basis (N, m), of the noise that it leaves itself."""
    return smooth(targets, basis, targets.energy / targets.components, TURNS[1])


def noise_left(targets: Targets, column: Array) -> float:
    """The noise variance that the most likely function of a column (N,) leaves at a place."""
    return _settled(targets, Sines.of("", column, LENGTH).values).noise


def without(targets: Targets, values: Array) -> Targets:
    """The targets once a function (N,) at their first site is taken off the residual."""
    seen = targets.cross[0] @ values
    column = targets.weight[0] * values - seen @ targets.cross[0]
    left = targets.energy - 2.0 * float(targets.pull[0] @ values) + float(column @ values)
    return replace(targets, pull=targets.pull - column, energy=max(left, LEAST))


def weighted_sum(targets: Targets, columns: Array) -> Array:
    """Weights (K,) of columns (K, N), two or more, in the sum of which a function saves most, the largest column's
    standard deviation counting 1."""
    spread, noise = columns.std(axis=1), targets.energy / targets.components
    scaled = columns / spread[:, None]

    def cost(weights: Array) -> float:
        return -smooth(targets, Sines.of("", weights @ scaled, LENGTH).values, noise).nats

    def beside(first: int, others: Array) -> Array:
        return np.insert(np.clip(others, -MOST, MOST), first, 1.0)

    count = len(columns)
    steps = np.linspace(-1.0, 1.0, DIRECTIONS[min(count, max(DIRECTIONS))])
    starts = ((first, np.array(o)) for first in range(count) for o in itertools.product(steps, repeat=count - 1))
    best = sorted(starts, key=lambda start: cost(beside(*start)))[:NEAREST]
    ends = [
        (first, minimize(lambda o, k=first: cost(beside(k, o)), others, method="Nelder-Mead", options=FINE))
        for first, others in best
    ]
    first, end = min(ends, key=lambda found: float(found[1].fun))
    return np.asarray(beside(first, end.x) / spread)


def distance(targets: Targets, columns: Array) -> tuple[float, float, float]:
    """A point in the plane of two columns (2, N), the distance from which says most, and how often the second counts.

    (a, b, w) of √((x - a)² + w² (y - b)²).
    """
    middle, spread = columns.mean(axis=1), columns.std(axis=1)
    scaled, noise = (columns - middle[:, None]) / spread[:, None], targets.energy / targets.components

    def cost(point: Array) -> float:
        away = np.hypot(scaled[0] - point[0], np.exp(point[2]) * (scaled[1] - point[1]))
        return -smooth(targets, Sines.of("", away, LENGTH).values, noise).nats

    starts = sorted((np.array([a, b, 0.0]) for a in POINTS for b in POINTS), key=cost)[:NEAREST]
    ends = (minimize(cost, start, method="Nelder-Mead", bounds=NEAR) for start in starts)
    found = min(ends, key=lambda end: float(end.fun))
    (a, b), log_ratio = middle + spread * found.x[:2], float(found.x[2])
    return float(a), float(b), float(np.exp(log_ratio) * spread[0] / spread[1])
