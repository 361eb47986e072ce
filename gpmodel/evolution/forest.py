"""Programs of several trees each, as flat prefix codes for the compiled loops."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code
from gpmodel.evolution.engine import empty_code
from gpmodel.evolution.machine import Layout

OPERATOR_CODES = 32
"""First code of a tree node that is an input or a fixed constant; smaller codes are operators."""

OWN_CONSTANT = 16384
"""First code of a tree node that is one of the constants that a program carries."""

OWN_BYTE = 255
"""Byte of every constant that a program carries, in a packed tree (one byte per node)."""


@dataclass(frozen=True)
class Forest:
    """Programs of several trees each, as flat prefix codes (one code per node).

    Tree k of program p is ``codes[bounds[p, k]:bounds[p, k + 1]]``. constants: (programs, constants) of each, padded.
    """

    codes: NDArray[np.int16]
    bounds: NDArray[np.int32]
    constants: Array

    def decoded(self, layout: Layout, part: slice) -> Code:
        """Return the effective code (instructions that reach an output) of a slice of programs."""
        from gpmodel.evolution.kernels.batch import decode_forest

        longest = int(np.max(self.bounds[part, -1] - self.bounds[part, 0]))
        code = empty_code(np.ascontiguousarray(self.constants[part]), longest, layout.outputs)
        decode_forest(self.codes, self.bounds[part], layout.tables, code)
        return code
