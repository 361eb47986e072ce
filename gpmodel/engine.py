"""Runs populations on the kernels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.layout import Layout
from gpmodel.population import Forest, Sequences

Array = NDArray[np.float64]

BLOCK = 128
"""Poses run at a time: the rows of one program then stay in the first cache."""


def aligned(shape: tuple[int, ...]) -> Array:
    """An uninitialised float64 array that starts on a 64-byte boundary."""
    size = int(np.prod(shape)) * 8
    buffer = np.empty(size + 64, dtype=np.uint8)
    offset = -buffer.ctypes.data % 64
    return buffer[offset : offset + size].view(np.float64).reshape(shape)


@dataclass(frozen=True)
class Code:
    """Effective code of a slice of programs, one row each: what the kernels execute."""

    op: NDArray[np.int16]
    first: NDArray[np.int16]
    second: NDArray[np.int16]
    mask: NDArray[np.uint8]
    outputs: NDArray[np.int16]
    count: NDArray[np.int16]
    sizes: NDArray[np.uint16]
    hashes: NDArray[np.uint64]
    constants: Array


def decode(population: Sequences | Forest, part: slice, layout: Layout) -> Code:
    """Effective code of a slice of a population."""
    from gpmodel.kernels.batch import decode_forests, decode_sequences

    constants = np.ascontiguousarray(population.constants[part])
    bits = constants.view(np.uint64)
    size = len(constants)
    if isinstance(population, Sequences):
        longest = population.genes.shape[1] + layout.own_constants
    else:
        longest = int(np.max(population.bounds[part, -1] - population.bounds[part, 0]))
    code = Code(
        *(np.empty((size, longest), np.int16) for _ in range(3)),
        np.empty((size, longest), np.uint8),
        np.empty((size, layout.outputs), np.int16),
        np.empty(size, np.int16),
        np.empty((size, 1 << layout.outputs), np.uint16),
        np.empty(size, np.uint64),
        constants,
    )
    sink = (code.op, code.first, code.second, code.mask, code.outputs, code.count, code.sizes, code.hashes)
    if isinstance(population, Sequences):
        tables = (layout.operator_of, layout.input_of, layout.register_of, layout.operand_of, layout.start_rows)
        decode_sequences(population.genes[part], constants, bits, *tables, layout.base, *sink)
    else:
        decode_forests(population.codes, population.bounds[part], bits, layout.base, *sink)
    return code


def values(code: Code, fixed: Array) -> Array:
    """Outputs (P, outputs, N) of decoded programs on fixed rows (base, N)."""
    from gpmodel.kernels.batch import output_values

    found = np.empty((len(code.count), code.outputs.shape[1], fixed.shape[1]))
    output_values(
        code.op, code.first, code.second, code.outputs, code.count, code.constants, fixed, _scratch(code, fixed), found
    )
    return found


def compensator_fitness(code: Code, fixed: Array, measured: Array, maximum: bool, hopeless: float) -> Array:
    """Fitness of Fig 5.5 (or the RMS of the same distances) of decoded programs; see ``kernels.batch``."""
    from gpmodel.kernels import batch

    found = np.empty(len(code.count))
    poses = fixed.shape[1]
    limit = hopeless**2 if maximum else hopeless**2 * poses
    batch.compensator_fitness(
        code.op, code.first, code.second, code.outputs, code.count, code.constants,
        fixed, _scratch(code, fixed), measured, maximum, limit, found,
    )  # fmt: skip
    return np.sqrt(found if maximum else found / poses)


def _scratch(code: Code, fixed: Array) -> Array:
    base, poses = fixed.shape
    width = min(BLOCK, (poses + 7) // 8 * 8)
    return aligned((base + int(code.count.max(initial=0)), width))
