"""Run populations of programs on the compiled kernels."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray

SLICE = 512
"""Number of programs that a thread runs together: their registers fit into its cache."""


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="gpmodel")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)


def over_slices(count: int, threads: int, work: Callable[[slice], None], size: int = SLICE) -> None:
    """Call ``work`` on fixed slices of ``range(count)``; the slices do not depend on ``threads``."""
    slices = [slice(begin, min(begin + size, count)) for begin in range(0, count, size)]
    if threads == 1 or len(slices) == 1:
        for part in slices:
            work(part)
    else:
        list(_pool(threads).map(work, slices))


BLOCK = 128
"""Poses that are run together if a program can be dropped after any block: its rows fit into the first-level cache."""

LONG_BLOCK = 512
"""Number of poses that are run together if no program is dropped. Rows in the second-level cache cost less than four
times as many jumps (18 %)."""


@dataclass(frozen=True)
class Code:
    """Effective code (instructions that reach an output) of P programs, as the kernels execute it.

    words: instructions (P, longest), of which the first ``count`` are used.
    outputs: (P, m) row of each output.
    nodes: (P,) number of operators and references to leaves.
    hashes: (P,) hash of the code.
    constants: (P, C) constants that belong to each program.
    """

    words: IntArray
    outputs: NDArray[np.uint16]
    count: IntArray
    nodes: IntArray
    hashes: NDArray[np.uint64]
    constants: Array

    def take(self, rows: NDArray[np.intp]) -> "Code":
        """Return the code of the programs at some rows."""
        return Code(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def empty_code(constants: Array, longest: int, outputs: int) -> Code:
    """Allocate the code of P programs with own constants (P, C), of at most ``longest`` instructions and ``outputs``
    outputs."""
    size = len(constants)
    return Code(
        workspace("words", (size, longest)).view(np.int64),
        np.empty((size, outputs), np.uint16),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.uint64),
        constants,
    )


def values(code: Code, fixed: Array) -> Array:
    """Return the outputs (P, outputs, N) of decoded programs on fixed rows (base, N); the next call overwrites them."""
    from gpmodel.evolution.kernels import batch

    found = workspace("values", (len(code.count), code.outputs.shape[1], fixed.shape[1]))
    batch.output_values(
        code.words, code.outputs, code.count, code.constants, fixed, _rows(code, fixed, LONG_BLOCK), found
    )
    return found


def sizes(code: Code, base: int) -> NDArray[np.uint16]:
    """Return the number (P, 2^m) of nodes of each program that reach exactly the outputs in each bit set.
    base: number of fixed rows."""
    from gpmodel.evolution.kernels import batch

    return batch.sizes_by_outputs(code.words, code.count, base, code.outputs)


def compensator_fitness(code: Code, fixed: Array, measured: Array, maximum: bool, hopeless: float) -> Array:
    """Return the largest distance (Fig 5.5), or the RMS distance, of each decoded program; see ``kernels.batch``."""
    from gpmodel.evolution.kernels import batch

    found = np.empty(len(code.count))
    poses = fixed.shape[1]
    limit = hopeless**2 if maximum else hopeless**2 * poses
    batch.compensator_fitness(
        code.words, code.outputs, code.count, code.constants,
        fixed, _rows(code, fixed, BLOCK), measured, maximum, limit, found,
    )  # fmt: skip
    return np.sqrt(found if maximum else found / poses)


def _rows(code: Code, fixed: Array, block: int) -> Array:
    base, poses = fixed.shape
    width = min(block, (poses + 7) // 8 * 8)
    return workspace("rows", (base + int(code.count.max(initial=0)) + 1, width))


def workspace(name: str, shape: tuple[int, ...]) -> Array:
    """Return a float64 array on a 64-byte boundary; the next call by the same thread with the same name reuses it."""
    size = int(np.prod(shape))
    held: dict[str, Array] = _buffers.__dict__
    if name not in held or held[name].size < size:
        buffer = np.empty(size * 8 + 64, dtype=np.uint8)
        offset = -buffer.ctypes.data % 64
        held[name] = buffer[offset : offset + size * 8].view(np.float64)
    return held[name][:size].reshape(shape)


_buffers = threading.local()
