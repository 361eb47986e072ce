"""Decoding and execution of slices of a population, each slice in one thread."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code, Tables
from gpmodel.evolution.kernels.compiler import compiled, inlined
from gpmodel.evolution.kernels.execute import execute
from gpmodel.evolution.kernels.machine import (
    CONSTANT,
    LAST_BINARY,
    ROW,
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
    stack, kinds = np.empty((2, code.words.shape[1] + 1), np.int64)
    for p in range(len(bounds)):
        code.length[p] = decode_trees(codes, bounds[p], tables, code.words[p], code.outputs[p], stack, kinds)
    _fill_hashes(code)


@inlined
def _mixed(value: np.uint64, place: int) -> np.uint64:
    mixed = (value ^ (np.uint64(place + 1) * np.uint64(0xD1342543DE82EF95))) * np.uint64(0x9E3779B97F4A7C15)
    return (mixed ^ (mixed >> np.uint64(32))) * np.uint64(0xBF58476D1CE4E5B9)


@compiled
def _fill_hashes(code: Code) -> None:
    """Fill the hashes of decoded programs: sums of instructions, constants and outputs mixed with their positions."""
    bits = code.constants.view(np.uint64)
    for p in range(len(code.words)):
        h, count = np.uint64(0), code.length[p]
        for k in range(count):
            word = code.words[p, k]
            h += _mixed(np.uint64(word), k)
            if word & ROW == CONSTANT:
                h += _mixed(bits[p, word >> 16], k + count)
        for k in range(code.outputs.shape[1]):
            h += _mixed(np.uint64(code.outputs[p, k]), k + 2 * count)
        code.hashes[p] = h


@compiled
def sizes_by_outputs(code: Code, base: int) -> NDArray[np.uint16]:
    """Return for each program the number of nodes that reach exactly the outputs of each bit set.

    The fixed rows and the constants before all operators are leaves, which count once for each use.
    """
    sizes = np.zeros((len(code.words), 1 << code.outputs.shape[1]), np.uint16)
    reach = np.empty(base + code.words.shape[1], np.uint8)
    for p in range(len(code.words)):
        words, count, size = code.words[p], code.length[p], sizes[p]
        reach[: base + count] = 0
        leaves = base
        while leaves < base + count and words[leaves - base] & ROW == CONSTANT:
            leaves += 1
        for k in range(code.outputs.shape[1]):
            row = code.outputs[p, k]
            reach[row] |= 1 << k
            size[1 << k] += row < leaves
        for k in range(count - 1, -1, -1):
            operator, a, b = words[k] & ROW, (words[k] >> 16) & ROW, words[k] >> 32
            bits = reach[base + k]
            if operator == CONSTANT:
                size[bits] += base + k >= leaves
            else:
                reach[a] |= bits
                reach[b] |= bits
                size[bits] += 1 + (a < leaves) + ((b < leaves) & (operator <= LAST_BINARY))
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
