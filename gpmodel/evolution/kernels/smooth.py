"""The most likely smooth function at a place, and factors of a product in turn: ``gpmodel.evolution.smooth``."""

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import compiled

_SETTLED = 1e-4
"""Relative change of the noise below which the turns end."""


@compiled
def normal_equations(basis: Array, weight: Array, cross: Array, pull: Array) -> tuple[Array, Array]:
    """Φᵀ(D - BᵀB)Φ (m, m) and Φᵀg (m,) of a basis Φ (N, m)."""
    poses, size = basis.shape
    weighted = np.empty((poses, size))
    for j in range(poses):
        for a in range(size):
            weighted[j, a] = weight[j] * basis[j, a]
    seen = np.dot(cross, basis)
    return np.dot(basis.T, weighted) - np.dot(seen.T, seen), np.dot(basis.T, pull)


@compiled
def most_likely(
    gram: Array, pull: Array, noise: float, energy: float, components: float, steps: int, turns: int, least: float
) -> tuple[Array, float, float]:
    """Coefficients (m,) of the most likely function, its nats, and the noise that it leaves.

    Expectation and maximisation of the variance, ``steps`` of them for each of ``turns`` values of the noise, of which
    each but the first is what the turn before left.
    """
    sizes, turn = np.linalg.eigh(gram)
    sizes = np.maximum(sizes, 0.0)
    along = np.dot(turn.T, pull)
    count = len(sizes)
    mean = np.zeros(count)
    nats, left = 0.0, noise
    total = max(sizes.sum(), least)
    for _ in range(turns):
        variance = noise * count / total
        for _ in range(steps):
            new = 0.0
            for a in range(count):
                spread = noise * variance / (noise + variance * sizes[a])
                new += (spread * along[a] / noise) ** 2 + spread
            variance = new / count
        nats, determined, rest = 0.0, 0.0, energy
        for a in range(count):
            load = variance * sizes[a]
            mean[a] = variance * along[a] / (noise + load)
            nats += 0.5 * (mean[a] * along[a] / noise - np.log1p(load / noise))
            determined += load / (noise + load)
            rest += mean[a] * (mean[a] * sizes[a] - 2.0 * along[a])
        left = max(rest, least) / max(components - determined, 1.0)
        if abs(left - noise) < _SETTLED * noise:
            break
        noise = left
    return np.dot(turn, mean), nats, left


@compiled
def factors_in_turn(
    bases: Array, values: Array, seen: tuple[Array, Array, Array], sizes: tuple[float, float, float],
    steps: int, turns: int,
) -> float:  # fmt: skip
    """Improve factors (K, N) of a product, functions of bases (K, N, m), one after the other in place; the noise left.

    seen: weight, cross and pull of the place. sizes: energy, components, and the least positive number.
    """
    weight, cross, pull = seen
    energy, components, least = sizes
    count, poses = values.shape
    noise = energy / components
    for _ in range(turns):
        before = noise
        for k in range(count):
            others = np.ones(poses)
            for i in range(count):
                if i != k:
                    others *= values[i]
            basis = bases[k] * others.reshape(-1, 1)
            gram, along = normal_equations(basis, weight, cross, pull)
            coefficients, _, left = most_likely(gram, along, noise, energy, components, steps, 1, least)
            value = np.dot(bases[k], coefficients)
            values[k] = value / max(np.sqrt(np.mean(value**2)), least)
        noise = left
        if abs(noise - before) < _SETTLED * before:
            break
    return noise


@compiled
def best_factors(
    bases: Array, starts: IntArray, seen: tuple[Array, Array, Array], sizes: tuple[float, float, float],
    steps: int, turns: tuple[int, int], kept: int, values: Array,
) -> float:  # fmt: skip
    """Fill the factors (K, N) of least noise, from starts (S, K - 1): numbers of sines of all factors but the first.

    turns: of every start, and of the ``kept`` best of them.
    """
    count, poses = values.shape
    begun, noise = np.ones((len(starts), count, poses)), np.empty(len(starts))
    for s in range(len(starts)):
        for k in range(1, count):
            begun[s, k] = bases[k, :, starts[s, k - 1]]
        noise[s] = factors_in_turn(bases, begun[s], seen, sizes, steps, turns[0])
    least = np.inf
    for s in np.argsort(noise)[:kept]:
        found = factors_in_turn(bases, begun[s], seen, sizes, steps, turns[1])
        if found < least:
            least = found
            values[:] = begun[s]
    return least
