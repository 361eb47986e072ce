"""Populations of either representation as the arrays that the kernels read."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sequences:
    """Linear sequences: genes (P, L) of uint8 and each program's own constants (P, own constants)."""

    genes: NDArray[np.uint8]
    constants: Array

    def __len__(self) -> int:
        return len(self.genes)

    def take(self, rows: NDArray[np.intp]) -> "Sequences":
        """The programs at some positions."""
        return Sequences(self.genes[rows], self.constants[rows])

    def join(self, other: "Sequences") -> "Sequences":
        """Both populations, this one first."""
        return Sequences(np.concatenate([self.genes, other.genes]), np.concatenate([self.constants, other.constants]))

    def constants_of(self, row: int) -> Array:
        """Own constants of one program."""
        return np.array(self.constants[row])

    def with_constants(self, row: int, values: Array) -> "Sequences":
        """The one program at ``row`` with other own constants."""
        return Sequences(self.genes[row : row + 1], values[None, :])


@dataclass(frozen=True)
class Forest:
    """Programs of several trees each, as flat prefix codes.

    Tree k of program p is ``codes[bounds[p, k]:bounds[p, k + 1]]``; constants is (P, most constants), padded.
    """

    codes: NDArray[np.int16]
    bounds: NDArray[np.int32]
    constants: Array

    def __len__(self) -> int:
        return len(self.bounds)


OPERATOR_CODES = 32
"""Prefix codes from here name a row of fixed values."""

OWN_CONSTANT = 16384
"""Prefix codes from here name one of the program's own constants."""
