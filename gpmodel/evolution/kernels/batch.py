"""Whole slices of a population through decoding and execution, one thread each."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.kernels.compiler import compiled, reduction
from gpmodel.evolution.kernels.execute import execute
from gpmodel.evolution.kernels.machine import (
    allowed_instructions,
    decode_sequence,
    decode_trees,
    keep_live,
    reaching_instructions,
    split_instructions,
)

Array = NDArray[np.float64]


@compiled
def decode_sequences(
    genes: NDArray[np.uint8],
    constant_bits: NDArray[np.uint64],
    operator_of: NDArray[np.uint8],
    cell_of: NDArray[np.uint16],
    read_of: NDArray[np.uint32],
    written_of: NDArray[np.uint32],
    start: NDArray[np.uint16],
    done_for: NDArray[np.uint16],
    kind_of_cells: NDArray[np.uint8],
    base: int,
    words: NDArray[np.int64],
    outputs: NDArray[np.uint16],
    count: NDArray[np.int64],
    sizes: NDArray[np.uint16],
    hashes: NDArray[np.uint64],
) -> None:
    """Effective code of each sequence of genes (P, L): words (P, longest), outputs (P, m), sizes (P, 2^m)."""
    registers = len(start)
    longest = words.shape[1]
    cells = np.empty(registers + base + constant_bits.shape[1] + 1, np.uint16)
    pairs = np.empty(longest, np.uint16)
    kinds = np.empty(len(kind_of_cells), np.uint8)
    for row in range(base + constant_bits.shape[1]):
        cells[registers + row] = row
    raw = np.empty(longest, np.int64)
    reach = np.empty(base + longest, np.uint8)
    leaf = np.ones(base + longest, np.uint8)
    place = np.arange(base + longest).astype(np.uint16)
    live = np.empty(longest + 1, np.uint16)
    own = constant_bits.shape[1]
    for p in range(len(genes)):
        found = split_instructions(genes[p], operator_of, pairs)
        if done_for.size:
            kinds[:] = kind_of_cells
            found = allowed_instructions(pairs, found, cell_of, done_for, kinds)
        begin = reaching_instructions(pairs, found, read_of, written_of, outputs.shape[1])
        n = decode_sequence(pairs, begin, found, cell_of, start, base, own, raw, outputs[p], cells)
        count[p], hashes[p] = keep_live(
            raw, words[p], n, base, outputs[p], constant_bits[p], sizes[p], reach, leaf, place, live
        )


@compiled
def decode_forest(
    codes: NDArray[np.int16],
    bounds: NDArray[np.int32],
    constant_bits: NDArray[np.uint64],
    base: int,
    done_for: NDArray[np.uint16],
    kind_of_rows: NDArray[np.uint8],
    words: NDArray[np.int64],
    outputs: NDArray[np.uint16],
    count: NDArray[np.int64],
    sizes: NDArray[np.uint16],
    hashes: NDArray[np.uint64],
) -> None:
    """Effective code of programs of several trees; bounds (P, roots + 1) index the flat prefix codes."""
    longest = words.shape[1]
    stack = np.empty(longest + 1, np.int64)
    kinds = np.empty(longest + 1, np.int64)
    raw = np.empty(longest, np.int64)
    reach = np.empty(base + longest, np.uint8)
    leaf = np.ones(base + longest, np.uint8)
    place = np.arange(base + longest).astype(np.uint16)
    live = np.empty(longest + 1, np.uint16)
    for p in range(len(bounds)):
        n = decode_trees(codes, bounds[p], base, done_for, kind_of_rows, raw, outputs[p], stack, kinds)
        count[p], hashes[p] = keep_live(
            raw, words[p], n, base, outputs[p], constant_bits[p], sizes[p], reach, leaf, place, live
        )


@compiled
def output_values(
    words: NDArray[np.int64],
    outputs: NDArray[np.uint16],
    count: NDArray[np.int64],
    constants: Array,
    fixed: Array,
    rows: Array,
    values: Array,
) -> None:
    """values (P, outputs, N) of decoded programs; fixed (base, N) are inputs and constants; rows is scratch."""
    base, poses = fixed.shape
    block = rows.shape[1]
    for begin in range(0, poses, block):
        width = min(block, poses - begin)
        for k in range(base):
            for j in range(width):
                rows[k, j] = fixed[k, begin + j]
        for p in range(len(words)):
            execute(words[p], count[p], constants[p], rows, base, width)
            for k in range(outputs.shape[1]):
                row = outputs[p, k]
                for j in range(width):
                    values[p, k, begin + j] = rows[row, j]


@reduction
def _largest(row: Array, width: int) -> float:
    value = row[0]
    for j in range(width):
        value = row[j] if row[j] > value else value
    return value


@reduction
def _sum(row: Array, width: int) -> float:
    value = 0.0
    for j in range(width):
        value += row[j]
    return value


@compiled
def compensator_fitness(
    words: NDArray[np.int64],
    outputs: NDArray[np.uint16],
    count: NDArray[np.int64],
    constants: Array,
    fixed: Array,
    rows: Array,
    measured: Array,
    maximum: bool,
    hopeless: float,
    fitness: Array,
) -> None:
    """Largest (or sum of) squared distance between three outputs and measured (3, N) over the poses.

    A program whose running value passes ``hopeless`` after a block of poses is dropped with an infinity; one
    with an output that is not finite is infinite. The last of ``rows`` is scratch for the squares.
    """
    base, poses = fixed.shape
    block = rows.shape[1]
    squares = rows[len(rows) - 1]
    fitness[:] = 0.0
    for begin in range(0, poses, block):
        width = min(block, poses - begin)
        for k in range(base):
            for j in range(width):
                rows[k, j] = fixed[k, begin + j]
        for p in range(len(words)):
            value = fitness[p]
            if value == np.inf:
                continue
            execute(words[p], count[p], constants[p], rows, base, width)
            x = outputs[p, 0]
            y = outputs[p, 1]
            z = outputs[p, 2]
            for j in range(width):
                dx = rows[x, j] - measured[0, begin + j]
                dy = rows[y, j] - measured[1, begin + j]
                dz = rows[z, j] - measured[2, begin + j]
                square = dx * dx + dy * dy + dz * dz
                squares[j] = square if square < np.inf else np.inf
            value = max(value, _largest(squares, width)) if maximum else value + _sum(squares, width)
            fitness[p] = value if value <= hopeless else np.inf
