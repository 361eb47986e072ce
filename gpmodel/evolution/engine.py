"""Run populations of programs with compiled loops."""

import threading

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code

BLOCK = 512
"""Number of poses at which programs run together: their values fit into the second-level cache."""


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

    programs, (base, poses) = len(code.length), fixed.shape
    width = min(BLOCK, (poses + 7) // 8 * 8)
    rows = workspace("rows", (base + int(code.length.max(initial=0)), width))
    found = workspace("values", (programs, code.outputs.shape[1], poses))
    batch.output_values(code, fixed, rows, found)
    return found


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
