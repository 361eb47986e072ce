"""What a program can read and where its parts are: inputs, constants, operators, registers, outputs."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.operators import INPUT, LOAD, STORE, Operator

Array = NDArray[np.float64]

OPERAND_ROWS = 256
"""An operand at or beyond this is a row of values, below it a register."""


@dataclass(frozen=True)
class Layout:
    """The element array of Table 5.1 (inputs, then fixed constants), and the machine around it.

    ``own_constants`` more constants belong to each program. ``start`` names what each register holds before
    the first operator (an input's name, or None for 0); the first ``outputs`` registers are offered at the
    end. ``direct`` lets binary operators name an element as well as a register (half of the operand codes).
    Raises InputError where sizes exceed what a gene or an output mask can address.
    """

    inputs: tuple[str, ...]
    operators: tuple[Operator, ...]
    constants: tuple[float, ...]
    start: tuple[str | None, ...]
    outputs: int
    own_constants: int = 0
    direct: bool = False
    moves: tuple[int, ...] = field(default=(INPUT, LOAD, STORE))

    def __post_init__(self) -> None:
        if len(set(self.inputs)) != len(self.inputs):
            raise InputError("inputs: a name appears twice")
        if not 1 <= self.outputs <= min(8, len(self.start)):
            raise InputError(f"outputs: {self.outputs}, expected 1 to {min(8, len(self.start))} registers")
        if self.elements > 256 or len(self.start) > 128:
            raise InputError(f"inputs: {self.elements} elements, at most 256 can be addressed")
        unknown = [name for name in self.start if name is not None and name not in self.inputs]
        if unknown:
            raise InputError(f"registers: no input {unknown[0]!r} to start from; inputs are {', '.join(self.inputs)}")

    @property
    def elements(self) -> int:
        """Inputs, fixed and own constants."""
        return len(self.inputs) + len(self.constants) + self.own_constants

    @property
    def zero_row(self) -> int:
        return len(self.inputs) + len(self.constants)

    @property
    def base(self) -> int:
        """Number of fixed rows: inputs, constants and the row of zeros."""
        return self.zero_row + 1

    def fixed_rows(self, values: Array) -> Array:
        """Rows (base, N) from the input values (inputs, N)."""
        constants = np.broadcast_to(
            np.array([*self.constants, 0.0])[:, None], (len(self.constants) + 1, values.shape[1])
        )
        return np.ascontiguousarray(np.vstack([values, constants]))

    def element_row(self, element: int) -> int:
        """Row of an element of the input array; own constants follow the fixed rows."""
        return element if element < self.zero_row else element + 1

    @cached_property
    def start_rows(self) -> NDArray[np.int16]:
        rows = [self.zero_row if name is None else self.inputs.index(name) for name in self.start]
        return np.array(rows, dtype=np.int16)

    @cached_property
    def operator_of(self) -> NDArray[np.int16]:
        """Op-code of each gene: a code on offer is itself, any other gene stands for one in turn."""
        offered = [*self.moves, *(operator.code for operator in self.operators)]
        table = [gene if gene in offered else offered[gene % len(offered)] for gene in range(256)]
        return np.array(table, dtype=np.int16)

    @cached_property
    def input_of(self) -> NDArray[np.int16]:
        return np.array([self.element_row(gene % self.elements) for gene in range(256)], dtype=np.int16)

    @cached_property
    def register_of(self) -> NDArray[np.int16]:
        return np.array([gene % len(self.start) for gene in range(256)], dtype=np.int16)

    @cached_property
    def operand_of(self) -> NDArray[np.int16]:
        """Second operand of each gene: a register, or with ``direct`` for odd genes an element's row."""
        if not self.direct:
            return self.register_of
        table = [
            OPERAND_ROWS + self.element_row(gene // 2 % self.elements) if gene % 2 else gene // 2 % len(self.start)
            for gene in range(256)
        ]
        return np.array(table, dtype=np.int16)
