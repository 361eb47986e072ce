"""From genes or tree codes to short straight-line code on rows of values.

Rows: the inputs, then the fixed constants (row ``zero`` holds 0), then one row an instruction. Moves between
accumulator and registers are renamed away, and only instructions that reach an output are kept. ``mask`` has
one bit an output that the instruction reaches.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

CONSTANT = 1
"""Pseudo op-code: fill the row with the program's own constant number ``first``."""

_FIRST_BINARY, _LAST_BINARY = 3, 9

compiled = njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract"})


@compiled
def _mix(h: int, v: int) -> int:
    h = (h ^ np.uint64(v)) * np.uint64(0x9E3779B97F4A7C15)
    return h ^ (h >> np.uint64(29))


@compiled
def keep_live(
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    mask: NDArray[np.uint8],
    count: int,
    base: int,
    outputs: NDArray[np.int16],
    constant_bits: NDArray[np.uint64],
    sizes: NDArray[np.uint16],
) -> tuple[int, int]:
    """Drop dead instructions in place; returns (instructions kept, hash of the effective code).

    ``sizes[m]`` becomes the operators plus leaf references that reach exactly the outputs of bit set m.
    """
    for k in range(count):
        mask[k] = 0
    sizes[:] = 0
    for k in range(len(outputs)):
        row = outputs[k]
        bit = np.uint8(1 << k)
        if row >= base:
            mask[row - base] |= bit
            if op[row - base] == CONSTANT:
                sizes[bit] += 1
        else:
            sizes[bit] += 1
    for k in range(count - 1, -1, -1):
        m = mask[k]
        if m == 0 or op[k] == CONSTANT:
            continue
        sizes[m] += 1
        a = first[k] - base
        if a >= 0:
            mask[a] |= m
        if a < 0 or op[a] == CONSTANT:
            sizes[m] += 1
        if _FIRST_BINARY <= op[k] <= _LAST_BINARY:
            b = second[k] - base
            if b >= 0:
                mask[b] |= m
            if b < 0 or op[b] == CONSTANT:
                sizes[m] += 1
    kept = 0
    h = np.uint64(1469598103934665603)
    place = np.empty(count, np.int16)
    for k in range(count):
        if mask[k] == 0:
            continue
        place[k] = kept
        o = op[k]
        a = first[k]
        b = second[k]
        if o == CONSTANT:
            h = _mix(h, constant_bits[a])
        else:
            if a >= base:
                a = np.int16(base + place[a - base])
            if b >= base:
                b = np.int16(base + place[b - base])
            h = _mix(h, np.uint64(o) | (np.uint64(a) << np.uint64(16)) | (np.uint64(b) << np.uint64(32)))
        op[kept] = o
        first[kept] = a
        second[kept] = b
        mask[kept] = mask[k]
        kept += 1
    for k in range(len(outputs)):
        if outputs[k] >= base:
            outputs[k] = base + place[outputs[k] - base]
        h = _mix(h, np.uint64(outputs[k]))
    return kept, h


@compiled
def decode_sequence(
    genes: NDArray[np.uint8],
    operator_of: NDArray[np.int16],
    input_of: NDArray[np.int16],
    register_of: NDArray[np.int16],
    operand_of: NDArray[np.int16],
    start: NDArray[np.int16],
    base: int,
    constants: int,
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    outputs: NDArray[np.int16],
) -> int:
    """Instructions of an accumulator-machine sequence; returns their number, dead code included.

    Op-codes 0 input, 1 load, 2 store and 3 to 9 take the next gene as operand, others do not; an op-code
    whose operand is beyond the end is dropped. ``operand_of`` below 256 is a register, above a row.
    Rows ``base`` to ``base + constants`` are the program's own constants.
    """
    count = constants
    for k in range(constants):
        op[k] = CONSTANT
        first[k] = k
        second[k] = 0
    register = start.copy()
    accumulator = np.int16(start[0])
    length = len(genes)
    i = 0
    while i < length:
        code = operator_of[genes[i]]
        i += 1
        if code > _LAST_BINARY:
            op[count] = code
            first[count] = accumulator
            second[count] = 0
            accumulator = np.int16(base + count)
            count += 1
            continue
        if i == length:
            break
        gene = genes[i]
        i += 1
        if code == 0:
            accumulator = input_of[gene]
        elif code == 1:
            accumulator = register[register_of[gene]]
        elif code == 2:
            register[register_of[gene]] = accumulator
        else:
            operand = operand_of[gene]
            op[count] = code
            first[count] = accumulator
            second[count] = register[operand] if operand < 256 else operand - 256
            accumulator = np.int16(base + count)
            count += 1
    for k in range(len(outputs)):
        outputs[k] = register[k]
    return count


@compiled
def decode_trees(
    codes: NDArray[np.int16],
    bounds: NDArray[np.int32],
    base: int,
    op: NDArray[np.int16],
    first: NDArray[np.int16],
    second: NDArray[np.int16],
    outputs: NDArray[np.int16],
) -> int:
    """Instructions of the trees ``codes[bounds[k]:bounds[k + 1]]``, each in depth-first (prefix) order.

    A code below 32 is an operator, below 16384 a row plus 32, beyond that a constant of the program plus
    16384. Returns the number of instructions.
    """
    count = 0
    stack = np.empty(bounds[-1] - bounds[0] + 1, np.int16)
    for root in range(len(outputs)):
        top = 0
        for i in range(bounds[root + 1] - 1, bounds[root] - 1, -1):
            code = codes[i]
            if code >= 16384:
                op[count] = CONSTANT
                first[count] = code - 16384
                second[count] = 0
            elif code >= 32:
                stack[top] = code - 32
                top += 1
                continue
            else:
                op[count] = code
                top -= 1
                first[count] = stack[top]
                second[count] = 0
                if code <= _LAST_BINARY:
                    top -= 1
                    second[count] = stack[top]
            stack[top] = base + count
            top += 1
            count += 1
        outputs[root] = stack[0]
    return count
