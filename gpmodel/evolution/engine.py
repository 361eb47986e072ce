"""Run populations of programs with compiled loops."""

import threading

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code

BLOCK = 128
"""Number of poses at which programs run together if they can be dropped: the values fit into the first-level cache."""

LONG_BLOCK = 512
"""Number of poses at which programs run together if none is dropped. Values in the second-level cache cost less than
four times as many jumps (18 %)."""


def empty_code(constants: Array, longest: int, outputs: int) -> Code:
    """Allocate the code of programs with own constants (programs, constants), of at most ``longest`` instructions and
    with ``outputs`` outputs each."""
    size = len(constants)
    return Code(
        workspace("words", (size, longest)).view(np.int64),
        np.empty((size, outputs), np.uint16),
        np.empty(size, np.int64),
        np.empty(size, np.uint64),
        constants,
    )


def values(code: Code, fixed: Array) -> Array:
    """Return the outputs (programs, outputs, poses) of decoded programs; the next call overwrites the array."""
    from gpmodel.evolution.kernels import batch

    found = workspace("values", (len(code.length), code.outputs.shape[1], fixed.shape[1]))
    batch.output_values(code, fixed, _rows(code, fixed, LONG_BLOCK), found)
    return found


def compensator_fitness(code: Code, fixed: Array, measured: Array, maximum: bool, cutoff: float) -> Array:
    """Return the largest or the RMS distance (Fig 5.5) of each program's output points from the measured points."""
    from gpmodel.evolution.kernels import batch

    found = np.empty(len(code.length))
    poses = fixed.shape[1]
    limit = cutoff**2 if maximum else cutoff**2 * poses
    batch.compensator_fitness(code, fixed, _rows(code, fixed, BLOCK), measured, maximum, limit, found)
    return np.sqrt(found if maximum else found / poses)


def _rows(code: Code, fixed: Array, block: int) -> Array:
    base, poses = fixed.shape
    width = min(block, (poses + 7) // 8 * 8)
    return workspace("rows", (base + int(code.length.max(initial=0)) + 1, width))


def workspace(name: str, shape: tuple[int, ...]) -> Array:
    """Return a float64 work array on a 64-byte boundary; a next call by the thread with the same name reuses it."""
    size = int(np.prod(shape))
    held: dict[str, Array] = _buffers.__dict__
    if name not in held or held[name].size < size:
        buffer = np.empty(size * 8 + 64, dtype=np.uint8)
        offset = -buffer.ctypes.data % 64
        held[name] = buffer[offset : offset + size * 8].view(np.float64)
    return held[name][:size].reshape(shape)


_buffers = threading.local()
