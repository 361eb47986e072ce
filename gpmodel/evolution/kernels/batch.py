"""Decoding and execution of slices of a population, each slice in one thread."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code, Tables
from gpmodel.evolution.kernels.compiler import compiled, inlined, largest_magnitude, reduction
from gpmodel.evolution.kernels.execute import execute
from gpmodel.evolution.kernels.live_code import count_by_outputs, hash_of, keep_live
from gpmodel.evolution.kernels.machine import (
    allowed_instructions,
    decode_sequence,
    decode_trees,
    reaching_instructions,
    split_instructions,
)


@compiled
def decode_sequences(genes: NDArray[np.uint8], tables: Tables, code: Code) -> None:
    """Decode sequences of bytes (programs, length) into effective code, whose arrays are filled."""
    own, start = code.constants.shape[1], len(tables.start)
    cells = np.empty(start + tables.base + own + 1, np.uint16)
    pairs = np.empty(code.words.shape[1], np.uint16)
    kinds = np.empty(len(tables.kinds), np.uint8)
    for row in range(tables.base):
        cells[start + row] = row
    for p in range(len(genes)):
        found = split_instructions(genes[p], tables.op_codes, pairs)
        if tables.replacements.size:
            for k in range(len(kinds)):
                kinds[k] = tables.kinds[k]
            found = allowed_instructions(pairs, found, tables, kinds)
        begin = reaching_instructions(pairs, found, tables, code.outputs.shape[1])
        code.length[p] = decode_sequence(pairs, begin, found, tables, own, code.words[p], code.outputs[p], cells)
    _fill_hashes(code)


@compiled
def decode_forest(codes: NDArray[np.int16], bounds: NDArray[np.int32], tables: Tables, code: Code) -> None:
    """Decode programs of several trees into effective code. bounds: position of each tree in the flat prefix codes."""
    base, longest = tables.base, code.words.shape[1]
    stack = np.empty(longest + 1, np.int64)
    kinds = np.empty(longest + 1, np.int64)
    live = np.empty(base + longest, np.uint8)
    place = np.arange(base + longest).astype(np.uint16)
    for p in range(len(bounds)):
        n = decode_trees(codes, bounds[p], tables, code.words[p], code.outputs[p], stack, kinds)
        if tables.replacements.size:
            n = keep_live(code.words[p], n, base, code.outputs[p], live, place)
        code.length[p] = n
    _fill_hashes(code)


@compiled
def _fill_hashes(code: Code) -> None:
    bits = code.constants.view(np.uint64)
    for p in range(len(code.words)):
        code.hashes[p] = hash_of(code.words[p], code.length[p], code.outputs[p], bits[p])


@compiled
def sizes_by_outputs(code: Code, base: int) -> NDArray[np.uint16]:
    """Return for each program the number of nodes that reach exactly the outputs of each bit set."""
    sizes = np.zeros((len(code.words), 1 << code.outputs.shape[1]), np.uint16)
    reach = np.empty(base + code.words.shape[1], np.uint8)
    for p in range(len(code.words)):
        count_by_outputs(code.words[p], code.length[p], base, code.outputs[p], sizes[p], reach)
    return sizes


@compiled
def output_values(code: Code, fixed: Array, rows: Array, values: Array) -> None:
    """Fill ``values`` (programs, outputs, poses) with the outputs of decoded programs. fixed: (rows, poses) values of
    inputs and constants. rows: scratch space for the results of instructions."""
    base, poses = fixed.shape
    block = rows.shape[1]
    for begin in range(0, poses, block):
        width = min(block, poses - begin)
        for k in range(base):
            for j in range(width):
                rows[k, j] = fixed[k, begin + j]
        for p in range(len(code.words)):
            execute(code.words[p], code.length[p], code.constants[p], rows, base, width)
            for k in range(code.outputs.shape[1]):
                found = rows[code.outputs[p, k]]
                value = values[p, k, begin:]
                for j in range(width):
                    value[j] = found[j]


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
    code: Code, fixed: Array, rows: Array, measured: Array, maximum: bool, cutoff: float, fitness: Array
) -> None:
    """Fill ``fitness`` with the largest or the summed squared distance of three outputs from measured points.

    The program of smallest fitness is the best. A program gets an infinite fitness, and runs on no further block of
    poses, once the fitness over the previous blocks exceeds ``cutoff`` or an output is not finite. The last row of
    ``rows`` is scratch space for the squares.
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
        for p in range(len(code.words)):
            value = fitness[p]
            if value == np.inf:
                continue
            execute(code.words[p], code.length[p], code.constants[p], rows, base, width)
            x, y, z = rows[code.outputs[p, 0]], rows[code.outputs[p, 1]], rows[code.outputs[p, 2]]
            for j in range(width):
                squares[j] = squared_distance(x[j] - true_x[j], y[j] - true_y[j], z[j] - true_z[j])
            value = max(value, largest_magnitude(squares[:width])) if maximum else value + _sum(squares, width)
            fitness[p] = value if value <= cutoff else np.inf
