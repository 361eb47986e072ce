"""The same decoding and execution on a CUDA device: a thread a sequence, then a block of threads a program.

What a gene, a word or an op-code means is in the kernels of the processor, which the device compiles again from their
source; here is only how the work is spread. What reckons with numbers that may not be finite is ``inlined`` there: of
``compiled`` functions the device takes "contract" for leave to assume that all are finite.
"""

import numpy as np
from numba import cuda
from numba.cuda import libdevice
from numba.extending import overload
from numpy.typing import NDArray

from gpmodel.evolution.kernels.batch import decode_every, squared_distance
from gpmodel.evolution.kernels.elementary import floor
from gpmodel.evolution.kernels.execute import execute
from gpmodel.evolution.machine import Layout

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_THREADS = 128
"""Of a block, a pose each, a power of two: further poses come after, as blocks of poses do on the processor."""

WARP = 32
"""Threads that a device runs at once in any case."""

DECODERS = 64
"""Threads of a block that decodes: no two of them share anything."""

ROOM = 2**28
"""Bytes on the device for the words of programs in hand, and as many for their rows: words of 65 536 sequences of 160
elements take a third of it, and their rows make blocks enough for every multiprocessor of the largest devices."""


overload(floor, target="cuda")(lambda x: lambda x: libdevice.floor(x))


@cuda.jit
def decode_kernel(
    genes, constant_bits, begun_by, cell_of, read_of, written_of, start, done_for, kind_of_cells, base,
    words, outputs, count, nodes, hashes, cells, pairs, kinds,
):  # fmt: skip
    """``batch.decode_sequences``; the last three are scratch, a column a thread."""
    first = cuda.grid(1)
    if first < cells.shape[1]:
        decode_every(
            first, cells.shape[1], genes, constant_bits, begun_by, cell_of, read_of, written_of, start, done_for,
            kind_of_cells, base, words, outputs, count, nodes, hashes,
            cells[:, first], pairs[:, first], kinds[:, first],
        )  # fmt: skip


@cuda.jit
def fitness_kernel(words, outputs, count, constants, fixed, rows, measured, maximum, fitness):
    """``batch.compensator_fitness`` without a limit; rows (blocks, rows, threads) is scratch, fitness zero at first."""
    squares = cuda.shared.array(MOST_THREADS, np.float64)
    base, poses = fixed.shape
    thread, threads = cuda.threadIdx.x, cuda.blockDim.x
    column = rows[cuda.blockIdx.x, :, thread : thread + 1]
    for begin in range(0, poses, threads):
        pose = begin + thread
        if pose < poses:
            for k in range(base):
                column[k, 0] = fixed[k, pose]
        for p in range(cuda.blockIdx.x, len(words), cuda.gridDim.x):
            squares[thread] = 0.0
            if pose < poses:
                execute(words[p], count[p], constants[p], column, base, 1)
                squares[thread] = squared_distance(
                    column[outputs[p, 0], 0] - measured[0, pose],
                    column[outputs[p, 1], 0] - measured[1, pose],
                    column[outputs[p, 2], 0] - measured[2, pose],
                )
            cuda.syncthreads()
            half = threads // 2
            while half > 0:
                if thread < half:
                    here, there = squares[thread], squares[thread + half]
                    squares[thread] = max(here, there) if maximum else here + there
                cuda.syncthreads()
                half //= 2
            if thread == 0:
                before = fitness[p]
                fitness[p] = max(before, squares[0]) if maximum else before + squares[0]


def compensator_fitness(
    genes: NDArray[np.uint8], constants: Array, layout: Layout, fixed: Array, measured: Array, maximum: bool
) -> tuple[Array, Counts, NDArray[np.uint64]]:
    """Largest (or sum of) squared distance of sequences (P, L) over the poses, their nodes and hashes, (P,) each.

    The numbers are those of ``batch.compensator_fitness`` but for rounding; nodes and hashes are the same. The genes, a
    byte each, are all of a generation that goes to the device.
    """
    fitness, nodes, hashes = np.empty(len(genes)), np.empty(len(genes), np.int64), np.empty(len(genes), np.uint64)
    size = max(1, ROOM // (8 * _longest(genes, layout)))
    points, goal = cuda.to_device(fixed), cuda.to_device(measured)
    for begin in range(0, len(genes), size):
        part = slice(begin, begin + size)
        own = np.ascontiguousarray(constants[part])
        words, outputs, count, *found = _decoded(np.ascontiguousarray(genes[part]), own, layout)
        nodes[part], hashes[part] = (array.copy_to_host() for array in found)
        threads = min(MOST_THREADS, max(WARP, 1 << (fixed.shape[1] - 1).bit_length()))
        height = len(fixed) + words.shape[1]
        blocks = min(len(own), max(1, ROOM // (8 * height * threads)))
        values = cuda.to_device(np.zeros(len(own)))
        fitness_kernel[blocks, threads](
            words, outputs, count, cuda.to_device(own), points, cuda.device_array((blocks, height, threads)), goal,
            maximum, values,
        )  # fmt: skip
        fitness[part] = values.copy_to_host()
    return fitness, nodes, hashes


def _longest(genes: NDArray[np.uint8], layout: Layout) -> int:
    return genes.shape[1] + layout.own_constants + 1


def _decoded(genes: NDArray[np.uint8], constants: Array, layout: Layout):
    """On the device: words (P, longest) of which ``count``, outputs (P, m), nodes and hashes of sequences (P, L)."""
    number, longest = len(genes), _longest(genes, layout)
    tables = (
        genes, constants.view(np.uint64), layout.begun_by, layout.cell_of, layout.read_of, layout.written_of,
        layout.start_rows, layout.done_for, layout.kind_of_cells,
    )  # fmt: skip
    cells = len(layout.start) + layout.base + layout.own_constants + 1
    found = [
        cuda.device_array((number, longest), np.int64), cuda.device_array((number, layout.outputs), np.uint16),
        cuda.device_array(number, np.int64), cuda.device_array(number, np.int64),
        cuda.device_array(number, np.uint64),
    ]  # fmt: skip
    scratch = (
        cuda.device_array((cells, number), np.uint16), cuda.device_array((longest, number), np.uint16),
        cuda.device_array((len(layout.kind_of_cells), number), np.uint8),
    )  # fmt: skip
    decode_kernel[-(-number // DECODERS), DECODERS](
        *(cuda.to_device(table) for table in tables), layout.base, *found, *scratch
    )
    return found
