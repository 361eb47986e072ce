"""From genes or tree codes to short straight-line code on rows of values.

Rows: the inputs, then the fixed constants (the last of them 0), then one row an instruction. An instruction
is one word, ``op-code + 2^16 first row + 2^32 second row`` (second 0 for one argument). Moves between
accumulator and registers are renamed away, and only instructions that reach an output are kept.
"""

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.kernels.compiler import compiled

CONSTANT = 1
"""Pseudo op-code: fill the row with the program's own constant number ``first``."""

_LAST_BINARY = 9
_ROW = 0xFFFF


@compiled
def _mix(h: np.uint64, v: int) -> np.uint64:
    h = (h ^ np.uint64(v)) * np.uint64(0x9E3779B97F4A7C15)
    return h ^ (h >> np.uint64(29))


@compiled
def keep_live(
    words: NDArray[np.int64],
    kept_words: NDArray[np.int64],
    count: int,
    base: int,
    outputs: NDArray[np.uint16],
    constant_bits: NDArray[np.uint64],
    sizes: NDArray[np.uint16],
    reach: NDArray[np.uint8],
    leaf: NDArray[np.uint8],
    place: NDArray[np.uint16],
    live: NDArray[np.uint16],
) -> tuple[int, np.uint64]:
    """Copy live instructions to ``kept_words``; returns (their number, hash of the effective code).

    ``sizes[m]`` becomes the operators plus leaf references that reach exactly the outputs of bit set m. The
    last four are scratch, one element a row; up to ``base`` leaf is 1 and place the row itself.
    """
    reach[: base + count] = 0
    sizes[:] = 0
    for k in range(count):
        leaf[base + k] = (words[k] & _ROW) == CONSTANT
    for k in range(len(outputs)):
        reach[outputs[k]] |= 1 << k
        sizes[1 << k] += leaf[outputs[k]]
    kept = 0
    for k in range(count - 1, -1, -1):
        bits = reach[base + k]
        live[kept] = k
        kept += bits != 0
        code = words[k] & _ROW
        operator = np.uint8(code != CONSTANT)
        a = ((words[k] >> 16) & _ROW) * operator
        b = words[k] >> 32
        reach[a] |= bits * operator
        reach[b] |= bits * operator
        sizes[bits] += operator * (1 + leaf[a] + leaf[b] * (code <= _LAST_BINARY))
    sizes[0] = 0
    h = np.uint64(1469598103934665603)
    for j in range(kept):
        k = np.int64(live[kept - 1 - j])
        place[base + k] = base + j
        word = words[k]
        if word & _ROW == CONSTANT:
            h = _mix(h, constant_bits[(word >> 16) & _ROW])
        else:
            a = np.int64(place[(word >> 16) & _ROW])
            b = np.int64(place[word >> 32])
            word = (word & _ROW) | (a << 16) | (b << 32)
            h = _mix(h, word)
        kept_words[j] = word
    for k in range(len(outputs)):
        outputs[k] = place[outputs[k]]
        h = _mix(h, outputs[k])
    return kept, h


@compiled
def split_instructions(genes: NDArray[np.uint8], operator_of: NDArray[np.uint8], pairs: NDArray[np.uint16]) -> int:
    """Each instruction of a sequence as ``256 op-code + operand gene`` (0 without operand); returns how many.

    An element begins an instruction unless the one before it does and takes an operand; an op-code whose
    operand is beyond the end is dropped. No branches on the op-code, which no processor could predict.
    """
    found = 0
    begins = 1
    last = len(genes) - 1
    code = np.int64(operator_of[genes[0]])
    for i in range(last):
        takes = np.int64(code <= _LAST_BINARY)
        gene = np.int64(genes[i + 1])
        pairs[found] = (code << 8) | (gene * takes)
        found += begins
        begins = 1 - (begins & takes)
        code = np.int64(operator_of[gene])
    pairs[found] = code << 8
    return found + (begins & (code > _LAST_BINARY))


@compiled
def allowed_instructions(
    pairs: NDArray[np.uint16],
    count: int,
    cell_of: NDArray[np.uint16],
    done_for: NDArray[np.uint16],
    kinds: NDArray[np.uint8],
) -> int:
    """Replace or leave out, in ``pairs``, operators that may not be applied; returns how many instructions stay.

    ``done_for[op-code, kind, kind]`` is ``256 op-code + kind`` of what is done instead, 0 for nothing; ``kinds`` (a
    number a cell, overwritten) are those of the registers at the start, then of the rows.
    """
    accumulator = np.int64(kinds[0])
    kept = 0
    for k in range(count):
        pair = np.int64(pairs[k])
        code = pair >> 8
        cell = cell_of[pair]
        if code > 2:
            second = np.int64(kinds[cell]) if code <= _LAST_BINARY else 0
            done = np.int64(done_for[code, accumulator, second])
            pairs[kept] = (done & 0xFF00) | (pair & 0xFF)
            accumulator = done & 0xFF if done else accumulator
            kept += done != 0
        else:
            if code == 2:
                kinds[cell] = accumulator
            else:
                accumulator = np.int64(kinds[cell])
            pairs[kept] = pair
            kept += 1
    return kept


@compiled
def reaching_instructions(
    pairs: NDArray[np.uint16],
    count: int,
    read_of: NDArray[np.uint32],
    written_of: NDArray[np.uint32],
    outputs: int,
) -> int:
    """Where, in ``pairs``, the instructions begin that can reach the first ``outputs`` registers.

    Goes backwards with the bit set of registers that are still to be read (the highest bit is the
    accumulator) and moves what is kept to the end of the first ``count``.
    """
    needed = (np.uint32(1) << np.uint32(outputs)) - np.uint32(1)
    begin = count
    for k in range(count - 1, -1, -1):
        pair = pairs[k]
        written = written_of[pair]
        live = np.uint32((needed & written) != 0)
        needed = (needed & ~written) | (read_of[pair] & (np.uint32(0) - live))
        pairs[begin - 1] = pair
        begin -= np.int64(live)
    return begin


@compiled
def decode_sequence(
    pairs: NDArray[np.uint16],
    begin: int,
    end: int,
    cell_of: NDArray[np.uint16],
    start: NDArray[np.uint16],
    base: int,
    constants: int,
    words: NDArray[np.int64],
    outputs: NDArray[np.uint16],
    cells: NDArray[np.uint16],
) -> int:
    """Words of the instructions ``pairs[begin:end]`` of an accumulator machine; returns their number.

    ``cell_of[pair]`` is the cell that the operand names: a register, or one that holds a row's number. Rows
    ``base`` to ``base + constants`` are the program's own constants. ``cells`` is scratch, with the row
    numbers behind the registers and one cell more.
    """
    count = constants
    for k in range(constants):
        words[k] = CONSTANT | (k << 16)
    for k in range(len(start)):
        cells[k] = start[k]
    accumulator = np.int64(start[0])
    unused = len(cells) - 1
    for k in range(begin, end):
        pair = pairs[k]
        code = np.int64(pair >> 8)
        cell = np.int64(cell_of[pair])
        value = np.int64(cells[cell])
        cells[cell if code == 2 else unused] = accumulator
        words[count] = code | (accumulator << 16) | (value << 32)
        moved = accumulator if code == 2 else value
        accumulator = base + count if code > 2 else moved
        count += code > 2
    for k in range(len(outputs)):
        outputs[k] = cells[k]
    return count


@compiled
def decode_trees(
    codes: NDArray[np.int16],
    bounds: NDArray[np.int32],
    base: int,
    done_for: NDArray[np.uint16],
    kind_of_rows: NDArray[np.uint8],
    words: NDArray[np.int64],
    outputs: NDArray[np.uint16],
    stack: NDArray[np.int64],
    kinds: NDArray[np.int64],
) -> int:
    """Instructions of the trees ``codes[bounds[k]:bounds[k + 1]]``, each in depth-first (prefix) order.

    A code below 32 is an operator, below 16384 a row plus 32, beyond that a constant of the program plus
    16384. Where ``done_for`` is given (see ``allowed_instructions``), an operator that may not be applied is replaced,
    or stands for its first argument. Returns the number of instructions; ``stack`` and ``kinds`` are scratch.
    """
    typed = done_for.size > 0
    count = 0
    for root in range(len(outputs)):
        top = 0
        for i in range(bounds[root + 1] - 1, bounds[root] - 1, -1):
            code = np.int64(codes[i])
            if code < 32:
                binary = code <= _LAST_BINARY
                first = stack[top - 1]
                kind = kinds[top - 1]
                second = stack[top - 2] if binary else 0
                if typed:
                    done = np.int64(done_for[code, kind, kinds[top - 2] if binary else 0])
                    code = done >> 8
                    kind = done & 0xFF if done else kind
                top -= 2 if binary else 1
                kinds[top] = kind
                stack[top] = base + count if code else first
                words[count] = code | (first << 16) | (second << 32)
                count += code != 0
            elif code < 16384:
                stack[top] = code - 32
                kinds[top] = kind_of_rows[code - 32]
            else:
                kinds[top] = 0
                words[count] = CONSTANT | ((code - 16384) << 16)
                stack[top] = base + count
                count += 1
            top += 1
        outputs[root] = stack[0]
    return count
