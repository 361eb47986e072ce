"""Smooth functions at a site, before a formula is known: of one input, or of several inputs.

Functions of several inputs are products, sums, a product plus a summand, a function of a weighted sum, or of a
distance. A function φ is a sum of sines Φ (poses, sines) with coefficients a of the prior variance τ of highest
evidence; D, B, g: weight, cross and pull of ``projection.Targets`` at the site; σ²: noise variance:
    a = (Φᵀ(D - BᵀB)Φ + σ²/τ I)⁻¹ Φᵀg,    φ = Φa
Source: Breiman and Friedman (1985) for alternating factors; Friedman and Stuetzle (1981) for functions of weighted
sums.
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
    """The sine functions of one input, from which a smooth function is formed.

    values: sines (poses, sines) times their relative prior standard deviations `spreads`.
    rates: rate of each sine, rad per unit of the input.
    start: value of the input where all sines are 0.
    """

    name: str
    values: Array
    rates: Array
    start: float
    spreads: Array

    @staticmethod
    def of(name: str, column: Array, length: float) -> "Sines":
        """Return the sines of an input. length: correlation length relative to half the range of the input."""
        half, reach = 0.5 * float(np.ptp(column)), max(1.5, 3.2 * length)
        omega = np.pi * np.arange(1, math.ceil(1.75 * reach / length) + 1) / (2.0 * reach)
        start = float(column.min()) - (reach - 1.0) * half
        spreads = np.exp(-((length * omega) ** 2) / 4.0)
        rates = np.array([float(f"{w / half:.6g}") for w in omega])
        start = float(f"{start:.12g}")  # times may have a distant origin
        return Sines(name, np.sin(np.outer(column - start, rates)) * spreads, rates, start, spreads)

    def text(self, k: int) -> str:
        """Return sine number k as the text of an expression."""
        return f"sin({float(self.rates[k])!r}*({self.name} - ({self.start!r})))"


LENGTH = 0.35
"""Correlation length of a smooth function over half its input's range: that of a bump over a fifth of the range."""
BEYOND = 100.0
"""Largest trial prior variance, relative to the variance at which a smooth function equals the whole residual."""
SETTLED = 1e-4
"""Relative change of the noise variance below which iterations for a smooth function end."""
TURNS, KEPT = (3, 15), 4
"""Numbers of iterations over a product's factors from all and from the best initial values; number of best ones."""
STARTS = {1: 1, 2: 8, 3: 5, 4: 3}
"""Number of initial functions (slow sines) of each factor but the first, by the number of factors of a product."""
PARTS_IN_TURN = 3
"""Number of iterations over a product and a summand; a fourth changes both by less than a tenth of the noise."""
DIRECTIONS, MOST = {2: 13, 3: 7, 4: 4}, 2.0
"""Number of trial weights from -1 to 1 of each input but one in a weighted sum, by the number of inputs; largest
weight."""
FINE = {"xatol": 0.01, "fatol": 0.01, "maxfev": 120}
"""Tolerances of the optimisation of the weights in a weighted sum of inputs."""
POINTS, NEAREST = (-1.2, -0.6, 0.0, 0.6, 1.2), 3
"""Coordinates of the first trial points from which distances are measured, in standard deviations of each input about
its mean; number of best points that are refined."""
NEAR = ((-3.0, 3.0), (-3.0, 3.0), (-1.5, 1.5))
"""Bounds of the point from which distances are measured, and of the logarithm of the ratio of the inputs' scales."""
LEAST = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Smooth:
    """A smooth function at a site. coefficients: factors of its sines. nats: gain, nats. noise: residual variance."""

    coefficients: Array
    nats: float
    noise: float


def smooth(targets: Targets, basis: Array, noise: float, turns: int = 1) -> Smooth:
    """Fit the function of highest evidence in the span of a basis (poses, functions), given a noise variance. turns:
    largest number of iterations; an iteration uses the residual variance of the previous one as noise variance."""
    axes = _axes(targets, basis[None])
    for _ in range(turns):
        found = _most_likely(targets, axes, np.array([noise]))
        before, noise = noise, float(found[2][0])
        if abs(noise - before) < SETTLED * before:
            break
    return Smooth(found[0][0], float(found[1][0]), noise)


_Axes = tuple[Array, Array, Array]
"""For several bases Φ: eigenvalues and eigenvectors of Φᵀ(D - BᵀB)Φ, and Φᵀg along the eigenvectors; symbols as in the
module docstring."""


def _axes(targets: Targets, basis: Array) -> _Axes:
    """Diagonalise Φᵀ(D - BᵀB)Φ of several bases Φ (bases, poses, functions). D, B: weight and cross of the targets."""
    weighted, seen = basis * targets.weight[0][:, None], targets.cross[0] @ basis
    sizes, turn = np.linalg.eigh(np.swapaxes(basis, 1, 2) @ weighted - np.swapaxes(seen, 1, 2) @ seen)
    return np.maximum(sizes, 0.0), turn, np.matmul((targets.pull[0] @ basis)[:, None, :], turn)[:, 0]


def _most_likely(targets: Targets, axes: _Axes, noise: Array) -> tuple[Array, Array, Array]:
    """Fit the function of highest evidence in the span of each basis, given one noise variance per basis. Return
    coefficients (bases, functions), and the gain in nats and the residual variance of each basis."""
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
    """Fit a product of one function of each column; return its residual variance and the factors (columns, poses).

    The factors have mean square 1. The factors are fitted in turn, from many starts of all factors but the first.
    """
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
    """Improve several products (products, factors, poses) of smooth functions in place, one factor after the other.
    Return the residual variance of each product."""
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


def through(targets: Targets, factor: Array) -> Targets:
    """Return residual statistics for the fit of a function f such that `factor` times f explains the residual."""
    return replace(targets, weight=targets.weight * factor**2, cross=targets.cross * factor, pull=targets.pull * factor)


def summands(targets: Targets, columns: Array) -> tuple[Array, Array]:
    """Return one function of each of two columns (2, poses), such that the sum of both has the highest evidence."""
    first, second = (Sines.of("", column, LENGTH).values for column in columns)
    found = _settled(targets, np.hstack([first, second]))
    one, other = np.split(found.coefficients, [first.shape[1]])
    return first @ one, second @ other


def product_and_summand(targets: Targets, columns: Array) -> tuple[float, Array, Array]:
    """Fit the sum of a function of the last column and a product of functions of the other columns (columns, poses).

    Product and summand are fitted in turn, with the other one subtracted. Return residual variance, product and summand
    (poses,).
    """
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
    """Fit the function of highest evidence in the span of a basis, with the residual variance as its noise variance."""
    return smooth(targets, basis, targets.energy / targets.components, TURNS[1])


def noise_left(targets: Targets, column: Array) -> float:
    """Return the residual variance after the best smooth function of a column (poses,) at a site."""
    return _settled(targets, Sines.of("", column, LENGTH).values).noise


def without(targets: Targets, values: Array) -> Targets:
    """Return the statistics of the residual at a site after the displacement by a basis function (poses,) is
    subtracted."""
    seen = targets.cross[0] @ values
    column = targets.weight[0] * values - seen @ targets.cross[0]
    left = targets.energy - 2.0 * float(targets.pull[0] @ values) + float(column @ values)
    return replace(targets, pull=targets.pull - column, energy=max(left, LEAST))


def weighted_sum(targets: Targets, columns: Array) -> Array:
    """Return the weights w of two or more columns x for which a smooth function of Σ w_i x_i has the highest evidence.
    The weights are scaled so that one weight times the standard deviation of its column is 1."""
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
    """Return a, b, w for which a smooth function of the distance √((x - a)² + w² (y - b)²) has the highest evidence. x,
    y: the two columns (2, poses)."""
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
