"""Live part of straight-line code (see ``machine``): instructions that reach an output, hash, numbers of nodes."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import IntArray
from gpmodel.evolution.kernels.compiler import compiled, inlined
from gpmodel.evolution.kernels.machine import CONSTANT, LAST_BINARY, ROW


@compiled
def keep_live(
    words: IntArray, count: int, base: int, outputs: NDArray[np.uint16],
    live: NDArray[np.uint8], place: NDArray[np.uint16],
) -> int:  # fmt: skip
    """Move the instructions that reach an output to the front of ``words`` and renumber rows; return their number.
    live, place: scratch space, one element per row. ``place[row]`` has to be ``row`` for the ``base`` fixed rows."""
    live[: base + count] = 0
    for k in range(len(outputs)):
        live[outputs[k]] = 1
    for k in range(count - 1, -1, -1):
        here = live[base + k]
        operator = np.uint8((words[k] & ROW) != CONSTANT)
        live[((words[k] >> 16) & ROW) * operator] |= here * operator
        live[words[k] >> 32] |= here * operator
    kept = 0
    for k in range(count):
        word = words[k]
        if live[base + k]:
            if word & ROW != CONSTANT:
                a = np.int64(place[(word >> 16) & ROW])
                b = np.int64(place[word >> 32])
                word = (word & ROW) | (a << 16) | (b << 32)
            words[kept] = word
            place[base + k] = base + kept
            kept += 1
    for k in range(len(outputs)):
        outputs[k] = place[outputs[k]]
    return kept


@inlined
def _mixed(value: np.uint64, place: int) -> np.uint64:
    mixed = (value ^ (np.uint64(place + 1) * np.uint64(0xD1342543DE82EF95))) * np.uint64(0x9E3779B97F4A7C15)
    return (mixed ^ (mixed >> np.uint64(32))) * np.uint64(0xBF58476D1CE4E5B9)


@inlined
def hash_of(words: IntArray, count: int, outputs: NDArray[np.uint16], constant_bits: NDArray[np.uint64]) -> np.uint64:
    """Return the hash of live code: a sum of instructions, constants and outputs mixed with their positions."""
    h = np.uint64(0)
    for k in range(count):
        h += _mixed(np.uint64(words[k]), k)
        if words[k] & ROW == CONSTANT:
            h += _mixed(constant_bits[words[k] >> 16], k + count)
    for k in range(len(outputs)):
        h += _mixed(np.uint64(outputs[k]), k + 2 * count)
    return h


@inlined
def count_by_outputs(
    words: IntArray,
    count: int,
    base: int,
    outputs: NDArray[np.uint16],
    sizes: NDArray[np.uint16],
    reach: NDArray[np.uint8],
) -> None:
    """Count the nodes of live code (code that reaches an output) by the bit set of outputs that the nodes reach. reach:
    scratch space, one element per row."""
    reach[: base + count] = 0
    leaves = base  # fixed rows and the program's constants, which come before all operators
    while leaves < base + count and words[leaves - base] & ROW == CONSTANT:
        leaves += 1
    for k in range(len(outputs)):
        reach[outputs[k]] |= 1 << k
        sizes[1 << k] += outputs[k] < leaves
    for k in range(count - 1, -1, -1):
        code = words[k] & ROW
        a = (words[k] >> 16) & ROW
        b = words[k] >> 32
        bits = reach[base + k]
        if code == CONSTANT:
            sizes[bits] += base + k >= leaves
        else:
            reach[a] |= bits
            reach[b] |= bits
            sizes[bits] += 1 + (a < leaves) + ((b < leaves) & (code <= LAST_BINARY))
