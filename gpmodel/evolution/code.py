"""Records that the compiled loops read and fill: tables of a layout, and effective code of programs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray


class Tables(NamedTuple):
    """Tables from which the compiled loops decode programs. An instruction is 256 * op-code + operand byte.

    op_codes: by instruction byte, 256 times its op-code, plus 255 if the op-code takes an operand.
    operands: operand of every instruction: register number, or number of registers + row number; row 0 without operand.
    writes, reads: bit mask of the registers that each instruction writes and reads.
    start: rows of values with which the registers start.
    replacements: operator that replaces an operator that is not allowed for its arguments, as in ``Typing.repairs``.
    kinds: number of the kind of quantity in each register at the start, then of each row of values.
    base: number of fixed rows.
    """

    op_codes: NDArray[np.uint16]
    operands: NDArray[np.uint16]
    writes: NDArray[np.uint32]
    reads: NDArray[np.uint32]
    start: NDArray[np.uint16]
    replacements: NDArray[np.uint16]
    kinds: NDArray[np.uint8]
    base: int


class Code(NamedTuple):
    """Effective code (instructions that reach an output) of programs, as the compiled loops execute it.

    words: instructions (programs, longest), of which the first ``length`` are used.
    outputs: instruction row of each output, (programs, outputs).
    nodes: number of operators and of references to leaves, per program.
    hashes: hash of the code, per program.
    constants: constants that belong to each program, (programs, constants).
    """

    words: IntArray
    outputs: NDArray[np.uint16]
    length: IntArray
    nodes: IntArray
    hashes: NDArray[np.uint64]
    constants: Array

    def take(self, rows: NDArray[np.intp]) -> "Code":
        """Return the code of the programs with the given row numbers."""
        return Code._make(part[rows] for part in self)
