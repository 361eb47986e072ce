"""Whole slices of a population through decoding and execution, one thread each."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.kernels.execute import execute
from gpmodel.kernels.machine import compiled, decode_sequence, decode_trees, keep_live

Array = NDArray[np.float64]


@compiled
def decode_sequences(
    genes: NDArray[np.uint8],
    constants: Array,
    constant_bits: NDArray[np.uint64],
    operator_of: NDArray[np.int16],
    input_of: NDArray[np.int16],
    register_of: NDArray[np.int16],
    operand_of: NDArray[np.int16],
    start: NDArray[np.int16],
    base: int,
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    mask: NDArray[np.uint8],
    outputs: NDArray[np.int16],
    count: NDArray[np.int16],
    sizes: NDArray[np.uint16],
    hashes: NDArray[np.uint64],
) -> None:
    """Effective code of each sequence in genes (P, L), into op, first, second, mask (P, longest) ..."""
    for p in range(len(genes)):
        n = decode_sequence(
            genes[p], operator_of, input_of, register_of, operand_of, start, base,
            constants.shape[1], op[p], first[p], second[p], outputs[p],
        )  # fmt: skip
        count[p], hashes[p] = keep_live(
            op[p], first[p], second[p], mask[p], n, base, outputs[p], constant_bits[p], sizes[p]
        )


@compiled
def decode_forests(
    codes: NDArray[np.int16],
    bounds: NDArray[np.int32],
    constant_bits: NDArray[np.uint64],
    base: int,
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    mask: NDArray[np.uint8],
    outputs: NDArray[np.int16],
    count: NDArray[np.int16],
    sizes: NDArray[np.uint16],
    hashes: NDArray[np.uint64],
) -> None:
    """Effective code of programs of several trees; bounds (P, roots + 1) index the flat prefix codes."""
    for p in range(len(bounds)):
        n = decode_trees(codes, bounds[p], base, op[p], first[p], second[p], outputs[p])
        count[p], hashes[p] = keep_live(
            op[p], first[p], second[p], mask[p], n, base, outputs[p], constant_bits[p], sizes[p]
        )


@compiled
def output_values(
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    outputs: NDArray[np.int16],
    count: NDArray[np.int16],
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
        for p in range(len(op)):
            execute(op[p], first[p], second[p], count[p], constants[p], rows, base, width)
            for k in range(outputs.shape[1]):
                row = outputs[p, k]
                for j in range(width):
                    values[p, k, begin + j] = rows[row, j]


@compiled
def compensator_fitness(
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    outputs: NDArray[np.int16],
    count: NDArray[np.int16],
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
    with an output that is not finite is infinite.
    """
    base, poses = fixed.shape
    block = rows.shape[1]
    fitness[:] = 0.0
    for begin in range(0, poses, block):
        width = min(block, poses - begin)
        for k in range(base):
            for j in range(width):
                rows[k, j] = fixed[k, begin + j]
        for p in range(len(op)):
            value = fitness[p]
            if value == np.inf:
                continue
            execute(op[p], first[p], second[p], count[p], constants[p], rows, base, width)
            x = outputs[p, 0]
            y = outputs[p, 1]
            z = outputs[p, 2]
            for j in range(width):
                dx = rows[x, j] - measured[0, begin + j]
                dy = rows[y, j] - measured[1, begin + j]
                dz = rows[z, j] - measured[2, begin + j]
                square = dx * dx + dy * dy + dz * dz
                if maximum:
                    value = value if value > square else square
                else:
                    value += square
            fitness[p] = value if value <= hopeless else np.inf
