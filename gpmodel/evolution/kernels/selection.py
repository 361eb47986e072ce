"""Selection of the best site of each program, and of the outputs with the best gain for their size."""

import math

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.evolution.code import Scores
from gpmodel.evolution.description_length import RESOLUTION
from gpmodel.evolution.kernels.compiler import compiled, largest_magnitude

_ROUNDING = 4e-15
_MORE = 1.0 + 1e-9
"""Factor by which a program's output has to gain more than an earlier output to replace it, beyond rounding errors."""


@compiled
def scale_and_multiply(values: Array, usable: Mask, products: Array) -> None:
    """Divide each row of values (programs, rows, poses) by its largest magnitude; fill the products of pairs of rows. A
    row that is zero or not finite becomes zero and is not usable. With products of size 0 no products are computed."""
    programs, outputs, poses = values.shape
    for p in range(programs):
        for i in range(outputs):
            row = values[p, i]
            broken = 0
            for j in range(poses):
                broken += not abs(row[j]) < 1e150
            largest = 0.0 if broken else largest_magnitude(row)
            usable[p, i] = largest > 1e-150
            scale = 1.0 / largest if usable[p, i] else 0.0
            for j in range(poses):
                row[j] = row[j] * scale if usable[p, i] else 0.0
        pair = 0
        for i in range(outputs):
            for k in range(i, outputs):
                for j in range(products.shape[2]):
                    products[p, pair, j] = values[p, i, j] * values[p, k, j]
                pair += 1


@compiled
def choose_outputs(
    products: Array,
    seen: Array,
    number: IntArray,
    pull: Array,
    usable: Mask,
    sizes: NDArray[np.uint16],
    energy: float,
    half_components: float,
    parsimony: float,
    unique_share: float,
    scores: Scores,
) -> None:
    """Select the outputs of each program at each site by forward selection, and the set with the least description
    length.

    products: (programs, pairs i <= j, sites), products of two outputs, weighted by the squared sensitivity.
    seen: (distinct outputs, columns, sites), products of outputs with the model's columns; number: (programs, outputs).
    pull: (programs, outputs, sites), products of the outputs with the residual.
    sizes: nodes by set of outputs; column i belongs to output i modulo the number of outputs.
    Outputs are added in the order of their gain; the step with the least
        score = half_components * log(1 - gain) + parsimony * (size of the chosen outputs + their number)
    is selected, the first of equal steps. 1 - gain is at least the rounding error of the least independent output, to
    distinguish exact fits from nearly singular ones. A program without gain has score 0 and gain 0.
    """
    programs, outputs, sites = pull.shape
    columns = seen.shape[1]
    roots = 0
    while sizes.shape[1] >> (roots + 1):
        roots += 1
    gram = np.empty((outputs, outputs))
    total = np.empty(outputs)
    rest = np.empty(outputs)
    inner = np.empty((products.shape[1], sites))
    for p in range(programs):
        scores.score[p] = 0.0
        scores.gain[p] = 0.0
        scores.complexity[p] = 0
        scores.site[p] = 0
        scores.chosen[p] = 0
        pair = 0
        for i in range(outputs):
            for j in range(i, outputs):
                first, second, both = seen[number[p, i]], seen[number[p, j]], inner[pair]
                both[:] = 0.0
                for k in range(columns):
                    for s in range(sites):
                        both[s] += first[k, s] * second[k, s]
                pair += 1
        for s in range(sites):
            pair = 0
            for i in range(outputs):
                for j in range(i, outputs):
                    gram[i, j] = products[p, pair, s] - inner[pair, s]
                    gram[j, i] = gram[i, j]
                    if i == j:
                        total[i] = products[p, pair, s]
                    pair += 1
                rest[i] = pull[p, i, s]
            explained = 0.0
            smallest = 1.0
            bits = 0
            for _ in range(outputs):
                best = -1
                most = 0.0
                for i in range(outputs):
                    if usable[p, i] and not (bits >> i) & 1 and gram[i, i] > unique_share * total[i]:
                        added = rest[i] * rest[i] / gram[i, i]
                        if added > most * _MORE:
                            most = added
                            best = i
                if best < 0:
                    break
                bits |= 1 << best
                explained += most / energy
                smallest = min(smallest, gram[best, best] / total[best])
                below = 0
                for i in range(outputs):
                    below |= ((bits >> i) & 1) << (i % roots)
                size = 0
                for subset in range(1, 1 << roots):
                    if subset & below:
                        size += sizes[p, subset]
                count = 0
                for i in range(outputs):
                    count += (bits >> i) & 1
                left = max(1.0 - explained, _ROUNDING / smallest)
                length = half_components * math.log(left) + parsimony * (size + count)
                if length < scores.score[p] - RESOLUTION:
                    scores.score[p] = length
                    scores.gain[p] = 1.0 - left
                    scores.complexity[p] = size
                    scores.site[p] = s
                    scores.chosen[p] = bits
                pivot = gram[best, best]
                for i in range(outputs):
                    if i != best:
                        factor = gram[i, best] / pivot
                        rest[i] -= factor * rest[best]
                        for j in range(outputs):
                            if j != best:
                                gram[i, j] -= factor * gram[best, j]
                for i in range(outputs):
                    gram[i, best] = 0.0
                    gram[best, i] = 0.0
