"""Records that the compiled loops read and fill: tables of a layout, and effective code of programs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray


class SiteStatistics(NamedTuple):
    """Statistics of the residual at one site, see ``projection.Targets``: weight and pull (poses,), cross (columns,
    poses). begins: position of the first number other than zero in each row of cross; many are zero after a QR
    decomposition."""

    weight: Array
    cross: Array
    begins: IntArray
    pull: Array
    energy: float
    unique_share: float


class Tables(NamedTuple):
    """Tables from which the compiled loops decode programs. An instruction is 256 * op-code + operand byte.

    op_codes: by instruction byte, 256 times its op-code, plus 255 if the op-code takes an operand.
    operands: operand of every instruction: register index, or number of registers + row index; row 0 without operand.
    writes, reads: bit mask of the registers that each instruction writes and reads.
    start: rows of values with which the registers start.
    replacements: operator that replaces an operator that is not allowed for its arguments, as in ``Typing.repairs``.
    kinds: index of the kind of quantity in each register at the start, then of each row of values.
    base: number of rows of values that all programs share (inputs, fixed constants, zeros).
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
    hashes: hash of the code, per program.
    constants: constants that belong to each program, (programs, constants).
    """

    words: IntArray
    outputs: NDArray[np.uint16]
    length: IntArray
    hashes: NDArray[np.uint64]
    constants: Array

    def take(self, rows: NDArray[np.intp]) -> "Code":
        """Return the code of the programs with the given row numbers."""
        return Code._make(part[rows] for part in self)


class Scores(NamedTuple):
    """Scores of programs, one row per program.

    score: value that the evolution minimises.
    gain: share of the residual that the program removes.
    complexity: number of nodes of the outputs in use.
    site: number of the program's best site.
    chosen: bit set of the outputs in use.
    hashes: hash of the effective code.
    """

    score: Array
    gain: Array
    complexity: IntArray
    site: IntArray
    chosen: IntArray
    hashes: NDArray[np.uint64]

    @staticmethod
    def empty(count: int) -> "Scores":
        """Allocate arrays for the scores of `count` programs."""
        complexity, site, chosen = (np.zeros(count, np.int64) for _ in range(3))
        return Scores(np.empty(count), np.empty(count), complexity, site, chosen, np.empty(count, np.uint64))

    def fill(self, part: slice | NDArray[np.intp], other: "Scores") -> None:
        """Set the scores of some programs."""
        for own, given in zip(self, other, strict=True):
            own[part] = given

    def take(self, rows: NDArray[np.intp]) -> "Scores":
        """Return the scores of the programs with the given row numbers."""
        return Scores._make(column[rows] for column in self)

    def join(self, other: "Scores") -> "Scores":
        """Return the scores of these programs followed by the scores of ``other``."""
        return Scores._make(map(np.concatenate, zip(self, other, strict=True)))
