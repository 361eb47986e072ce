"""Decoding and execution of slices of a population, each slice in one thread."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import compiled, inlined, reduction
from gpmodel.evolution.kernels.execute import execute
from gpmodel.evolution.kernels.live_code import count_by_outputs, keep_live, nodes_and_hash
from gpmodel.evolution.kernels.machine import (
    allowed_instructions,
    decode_sequence,
    decode_trees,
    reaching_instructions,
    split_instructions,
)


@compiled
def decode_sequences(
    genes: NDArray[np.uint8],
    constant_bits: NDArray[np.uint64],
    op_codes: NDArray[np.uint16],
    operand_table: NDArray[np.uint16],
    read_mask: NDArray[np.uint32],
    write_mask: NDArray[np.uint32],
    start: NDArray[np.uint16],
    replacements: NDArray[np.uint16],
    cell_kinds: NDArray[np.uint8],
    base: int,
    words: IntArray,
    outputs: NDArray[np.uint16],
    count: IntArray,
    nodes: IntArray,
    hashes: NDArray[np.uint64],
) -> None:
    """Decode sequences of bytes (programs, length) into effective code; ``engine.Code`` describes the filled arrays."""
    own = constant_bits.shape[1]
    cells = np.empty(len(start) + base + own + 1, np.uint16)
    pairs = np.empty(words.shape[1], np.uint16)
    kinds = np.empty(len(cell_kinds), np.uint8)
    for row in range(base):
        cells[len(start) + row] = row
    for p in range(len(genes)):
        found = split_instructions(genes[p], op_codes, pairs)
        if replacements.size:
            for k in range(len(cell_kinds)):
                kinds[k] = cell_kinds[k]
            found = allowed_instructions(pairs, found, operand_table, replacements, kinds)
        begin = reaching_instructions(pairs, found, read_mask, write_mask, outputs.shape[1])
        n = decode_sequence(pairs, begin, found, operand_table, start, base, own, words[p], outputs[p], cells)
        count[p] = n
        nodes[p], hashes[p] = nodes_and_hash(words[p], n, base, outputs[p], constant_bits[p])


@compiled
def decode_forest(
    codes: NDArray[np.int16],
    bounds: NDArray[np.int32],
    constant_bits: NDArray[np.uint64],
    base: int,
    replacements: NDArray[np.uint16],
    row_kinds: NDArray[np.uint8],
    words: IntArray,
    outputs: NDArray[np.uint16],
    count: IntArray,
    nodes: IntArray,
    hashes: NDArray[np.uint64],
) -> None:
    """Decode programs of several trees into effective code. bounds: position of each tree in the flat prefix codes."""
    longest = words.shape[1]
    stack = np.empty(longest + 1, np.int64)
    kinds = np.empty(longest + 1, np.int64)
    live = np.empty(base + longest, np.uint8)
    place = np.arange(base + longest).astype(np.uint16)
    for p in range(len(bounds)):
        n = decode_trees(codes, bounds[p], base, replacements, row_kinds, words[p], outputs[p], stack, kinds)
        if replacements.size:
            n = keep_live(words[p], n, base, outputs[p], live, place)
        count[p] = n
        nodes[p], hashes[p] = nodes_and_hash(words[p], n, base, outputs[p], constant_bits[p])


@compiled
def sizes_by_outputs(words: IntArray, count: IntArray, base: int, outputs: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return for each program the number of nodes that reach exactly the outputs of each bit set."""
    sizes = np.zeros((len(words), 1 << outputs.shape[1]), np.uint16)
    reach = np.empty(base + words.shape[1], np.uint8)
    for p in range(len(words)):
        count_by_outputs(words[p], count[p], base, outputs[p], sizes[p], reach)
    return sizes


@compiled
def output_values(
    words: IntArray,
    outputs: NDArray[np.uint16],
    count: IntArray,
    constants: Array,
    fixed: Array,
    rows: Array,
    values: Array,
) -> None:
    """Fill ``values`` (programs, outputs, poses) with the outputs of decoded programs. fixed: (rows, poses) values of
    inputs and constants. rows: scratch space for the results of instructions."""
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
                found = rows[outputs[p, k]]
                value = values[p, k, begin:]
                for j in range(width):
                    value[j] = found[j]


@reduction
def _largest(row: Array, width: int) -> float:
    value: float = row[0]
    for j in range(width):
        value = row[j] if row[j] > value else value
    return value


@reduction
def _sum(row: Array, width: int) -> float:
    value = 0.0
    for j in range(width):
        value += row[j]
    return value


@inlined
def squared_distance(dx: float, dy: float, dz: float) -> float:
    """Return the square of the distance (dx, dy, dz), infinite if the square is not a number."""
    square = dx * dx + dy * dy + dz * dz
    return square if square < np.inf else np.inf


@compiled
def compensator_fitness(
    words: IntArray,
    outputs: NDArray[np.uint16],
    count: IntArray,
    constants: Array,
    fixed: Array,
    rows: Array,
    measured: Array,
    maximum: bool,
    cutoff: float,
    fitness: Array,
) -> None:
    """Fill ``fitness`` with the largest squared distance, or the sum, of three outputs from the measured points.

    A program is dropped with an infinite fitness once its value exceeds ``cutoff`` after a block of poses, or if an
    output is not finite. The last row of ``rows`` is scratch space for the squares.
    """
    base, poses = fixed.shape
    block = rows.shape[1]
    squares = rows[len(rows) - 1]
    fitness[:] = 0.0
    for begin in range(0, poses, block):
        width = min(block, poses - begin)
        true_x, true_y, true_z = measured[0, begin:], measured[1, begin:], measured[2, begin:]
        for k in range(base):
            for j in range(width):
                rows[k, j] = fixed[k, begin + j]
        for p in range(len(words)):
            value = fitness[p]
            if value == np.inf:
                continue
            execute(words[p], count[p], constants[p], rows, base, width)
            x, y, z = rows[outputs[p, 0]], rows[outputs[p, 1]], rows[outputs[p, 2]]
            for j in range(width):
                squares[j] = squared_distance(x[j] - true_x[j], y[j] - true_y[j], z[j] - true_z[j])
            value = max(value, _largest(squares, width)) if maximum else value + _sum(squares, width)
            fitness[p] = value if value <= cutoff else np.inf
