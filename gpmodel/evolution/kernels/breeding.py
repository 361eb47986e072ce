"""Crossover and mutation of linear sequences (Robertson 2003, Fig 5.3), with one random stream per child."""

import math

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import compiled


@compiled
def _next(state: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the next state and 64 random bits of the generator SplitMix64 (Steele, Lea, Flood 2014)."""
    state = np.uint64(state + np.uint64(0x9E3779B97F4A7C15))
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state, z ^ (z >> np.uint64(31))


@compiled
def _uniform(bits: np.uint64) -> float:
    return (np.float64(bits >> np.uint64(11)) + 0.5) * 1.1102230246251565e-16


@compiled
def _gap(bits: np.uint64, log_keep: float, length: int) -> int:
    """Draw the number of elements until the next crossover or mutation, from the geometric distribution."""
    if log_keep == 0.0:
        return length
    gap = math.log(_uniform(bits)) / log_keep
    return np.int64(gap) if gap < length else length


@compiled
def _copy(source: NDArray[np.uint8], target: NDArray[np.uint8]) -> None:
    for k in range(len(target)):
        target[k] = source[k]


@compiled
def breed_sequences(
    genes: NDArray[np.uint8],
    constants: Array,
    mothers: IntArray,
    fathers: IntArray,
    seed: np.uint64,
    crossover: float,
    mutation: float,
    child_genes: NDArray[np.uint8],
    child_constants: Array,
) -> None:
    """Fill the genes and constants of the children of pairs of parents.

    At each element copying switches to the other parent at rate ``crossover``, and the element is replaced by a random
    element at rate ``mutation``. The constants of a child come from the parent that is copied last. At a rate of a
    quarter per mutated element, at most 0.5 per child, one constant is multiplied by exp(N(0, 0.5)) or drawn again.
    """
    length = genes.shape[1]
    log_cross = math.log1p(-crossover)
    log_mutate = math.log1p(-mutation)
    own = constants.shape[1]
    for child in range(len(mothers)):
        state = np.uint64(seed) ^ (np.uint64(child + 1) * np.uint64(0xD1342543DE82EF95))
        state, bits = _next(state)
        here = mothers[child]
        there = fathers[child]
        _copy(genes[here], child_genes[child])
        state, bits = _next(state)
        i = 1 + _gap(bits, log_cross, length)
        while i < length:
            here, there = there, here
            _copy(genes[here, i:], child_genes[child, i:])
            state, bits = _next(state)
            i += 1 + _gap(bits, log_cross, length)
        for c in range(own):
            child_constants[child, c] = constants[here, c]
        state, bits = _next(state)
        i = _gap(bits, log_mutate, length)
        while i < length:
            state, bits = _next(state)
            child_genes[child, i] = np.uint8(bits >> np.uint64(32))
            state, bits = _next(state)
            i += 1 + _gap(bits, log_mutate, length)
        if own > 0:
            state, bits = _next(state)
            if _uniform(bits) < min(0.5, mutation * length / 4.0):
                state, bits = _next(state)
                c = np.int64((bits >> np.uint64(33)) % np.uint64(own))
                state, bits = _next(state)
                radius = math.sqrt(-2.0 * math.log(_uniform(bits)))
                state, bits = _next(state)
                normal = radius * math.cos(2.0 * math.pi * _uniform(bits))
                state, bits = _next(state)
                if bits & np.uint64(3):
                    child_constants[child, c] *= math.exp(0.5 * normal)
                else:
                    child_constants[child, c] = 2.0 * normal
