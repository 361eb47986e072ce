"""Decoding of instruction bytes and tree codes into straight-line code on rows of values.

The rows are: inputs, fixed constants (the last is 0), then the result of each instruction. An instruction is one word,
``op-code + 2^16 first row + 2^32 second row`` (second 0 for one argument). Moves between accumulator and registers
become renamed rows, and only instructions that reach an output are kept.
"""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import IntArray
from gpmodel.evolution.code import Tables
from gpmodel.evolution.kernels.compiler import compiled, inlined

CONSTANT = 1
"""Special op-code that fills a row of values with the program's constant number ``first``."""

LAST_BINARY = 9
"""Largest op-code that takes two arguments or an operand."""

ROW = 0xFFFF
"""Mask of the bits of an instruction word that hold a row index."""


@inlined
def split_instructions(genes: NDArray[np.uint8], op_codes: NDArray[np.uint16], pairs: NDArray[np.uint16]) -> int:
    """Split a sequence of bytes into instructions 256 * op-code + operand byte, 0 without operand; return how many.

    ``op_codes[byte]`` is 256 times the op-code, plus 255 with an operand. A byte begins an instruction unless it is the
    operand of the byte before it. An op-code at the end without its operand is dropped. The code has no branch on the
    op-code, because a processor could not predict branches.
    """
    found = 0
    is_operand = 0
    here = np.int64(op_codes[genes[0]])
    for i in range(len(genes) - 1):
        gene = np.int64(genes[i + 1])
        pairs[found] = here & (gene | 0xFF00)
        found += 1 - is_operand
        is_operand = here & ~is_operand & 1
        here = np.int64(op_codes[gene])
    pairs[found] = here & 0xFF00
    return found + (~is_operand & ~here & 1)


@compiled
def allowed_instructions(pairs: NDArray[np.uint16], count: int, tables: Tables, kinds: NDArray[np.uint8]) -> int:
    """Replace or drop, in ``pairs``, operators that are not allowed; return the number of instructions that remain.

    kinds: work array, on entry the kind of quantity
    in each register at the start, then in each row of values; register kinds are overwritten.
    """
    accumulator = np.int64(kinds[0])
    kept = 0
    for k in range(count):
        pair = np.int64(pairs[k])
        code = pair >> 8
        cell = tables.operands[pair]
        if code > 2:
            second = np.int64(kinds[cell]) if code <= LAST_BINARY else 0
            done = np.int64(tables.replacements[code, accumulator, second])
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


@inlined
def reaching_instructions(pairs: NDArray[np.uint16], count: int, tables: Tables, outputs: int) -> int:
    """Move the instructions that influence the outputs to the end of the program ``pairs``; return the position of the
    first of these instructions.

    Instructions are visited backwards, with the bit set of registers that are still needed (the highest bit is the
    accumulator). Instructions after the last store to an output have no effect and are left out.
    """
    needed = (np.uint32(1) << np.uint32(outputs)) - np.uint32(1)
    end = count
    while end > 0 and (tables.writes[pairs[end - 1]] & needed) == 0:
        end -= 1
    begin = count
    for k in range(end - 1, -1, -1):
        pair = pairs[k]
        written = tables.writes[pair]
        read = tables.reads[pair]
        live = (needed & written) != 0
        needed = (needed & ~written) | (read if live else np.uint32(0))
        pairs[begin - 1] = pair
        begin -= np.int64(live)
    return begin


@inlined
def decode_sequence(
    pairs: NDArray[np.uint16],
    begin: int,
    end: int,
    tables: Tables,
    constants: int,
    words: IntArray,
    outputs: NDArray[np.uint16],
    cells: NDArray[np.uint16],
) -> int:
    """Fill the words of the instructions ``pairs[begin:end]`` of an accumulator machine; return the number of words.

    The cell of an instruction's operand is a register, or a cell with the index of a row of values. The last
    ``constants`` rows are the program's constants; constants in use become the first words. cells: scratch space, with
    the row numbers after the registers and one further cell.
    """
    count, start, base = 0, tables.start, tables.base
    own = len(start) + base
    if constants:
        for c in range(constants):
            cells[own + c] = 0
        for k in range(begin, end):
            cell = np.int64(tables.operands[pairs[k]])
            cells[cell if cell >= own else len(cells) - 1] = 1
        for c in range(constants):
            words[count] = CONSTANT | (c << 16)
            read = np.int64(cells[own + c])
            cells[own + c] = base + count
            count += read
    for k in range(len(start)):
        cells[k] = start[k]
    accumulator = np.int64(start[0])
    unused = len(cells) - 1
    for k in range(begin, end):
        pair = pairs[k]
        code = np.int64(pair >> 8)
        cell = np.int64(tables.operands[pair])
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
    tables: Tables,
    words: IntArray,
    outputs: NDArray[np.uint16],
    stack: IntArray,
    kinds: IntArray,
) -> int:
    """Fill the instructions of the trees ``codes[bounds[k]:bounds[k + 1]]`` in prefix order; return their number.

    A code below 32 is an operator, below 16384 a row plus 32, otherwise a program's constant plus 16384. An
    operator that the tables do not allow is replaced by another or by its argument.
    stack, kinds: scratch arrays.
    """
    typed, base, row_kinds = tables.replacements.size > 0, tables.base, tables.kinds[len(tables.start) :]
    count = 0
    for root in range(len(outputs)):
        top = 0
        for i in range(bounds[root + 1] - 1, bounds[root] - 1, -1):
            code = np.int64(codes[i])
            if code < 32:
                binary = code <= LAST_BINARY
                first = stack[top - 1]
                kind = kinds[top - 1]
                second = stack[top - 2] if binary else 0
                if typed:
                    done = np.int64(tables.replacements[code, kind, kinds[top - 2] if binary else 0])
                    code = done >> 8
                    kind = done & 0xFF if done else kind
                top -= 2 if binary else 1
                kinds[top] = kind
                stack[top] = base + count if code else first
                words[count] = code | (first << 16) | (second << 32)
                count += code != 0
            elif code < 16384:
                stack[top] = code - 32
                kinds[top] = row_kinds[code - 32]
            else:
                kinds[top] = 0
                words[count] = CONSTANT | ((code - 16384) << 16)
                stack[top] = base + count
                count += 1
            top += 1
        outputs[root] = stack[0]
    return count
