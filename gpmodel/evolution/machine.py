"""Layout of a program: inputs, constants, operators, registers, outputs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.evolution.code import Tables
from gpmodel.evolution.kinds import Typing
from gpmodel.formula.operators import BY_CODE, INPUT, LOAD, STORE, Operator

ACCUMULATOR = np.uint32(1 << 31)
"""Bit that represents the accumulator in a bit set of registers."""


@dataclass(frozen=True)
class Layout:
    """The inputs and fixed constants that programs may use (Table 5.1), and the accumulator machine that runs programs.

    own_constants: number of further constants of each program.
    start: initial value of each register: the name of an input, or None for 0.
    outputs: number of outputs, which are the first registers.
    direct: True if half of the operand codes of binary operators are inputs or constants, the other half registers.
    kinds: kind of quantity of each input, which restricts the operations. Inputs without kinds restrict no operation.
    Raises InputError if a size exceeds what an instruction byte or an output mask can address.
    """

    inputs: tuple[str, ...]
    operators: tuple[Operator, ...]
    constants: tuple[float, ...]
    start: tuple[str | None, ...]
    outputs: int
    own_constants: int = 0
    direct: bool = False
    kinds: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(set(self.inputs)) != len(self.inputs):
            raise InputError("inputs: a name appears twice")
        if not 1 <= self.outputs <= min(8, len(self.start)):
            raise InputError(f"outputs: {self.outputs}, expected 1 to {min(8, len(self.start))} registers")
        if self.elements > 256 or len(self.start) > 31:
            raise InputError(f"inputs: {self.elements} elements, at most 256 can be addressed")
        unknown = [name for name in self.start if name is not None and name not in self.inputs]
        if unknown:
            said = choices(unknown[0], self.inputs)
            raise InputError(f"registers: no input {unknown[0]!r} to start from; inputs are {said}")

    @property
    def elements(self) -> int:
        """Number of inputs, fixed constants and constants that a program carries."""
        return len(self.inputs) + len(self.constants) + self.own_constants

    @property
    def zero_row(self) -> int:
        """Index of the row of zeros in the table (rows, poses) of input values, fixed constants and zeros."""
        return len(self.inputs) + len(self.constants)

    @property
    def base(self) -> int:
        """Number of rows of values that all programs share: inputs, fixed constants and one row of zeros."""
        return self.zero_row + 1

    def fixed_rows(self, values: Array) -> Array:
        """Return the fixed rows (rows, poses) for input values (inputs, poses)."""
        constants = np.broadcast_to(
            np.array([*self.constants, 0.0])[:, None], (len(self.constants) + 1, values.shape[1])
        )
        return np.ascontiguousarray(np.vstack([values, constants]))

    def element_row(self, element: int) -> int:
        """Return the row index of an input or constant in the table of values; a program's own constants are the last
        rows."""
        return element if element < self.zero_row else element + 1

    @cached_property
    def opcode_table(self) -> NDArray[np.uint8]:
        """Op-code of each instruction byte (0 to 255). A byte that is the op-code of an available operator means this
        operator; other bytes mean the available operators in turn."""
        offered = [INPUT, LOAD, STORE, *(operator.code for operator in self.operators)]
        table = [gene if gene in offered else offered[gene % len(offered)] for gene in range(256)]
        return np.array(table, dtype=np.uint8)

    def operand(self, code: int, gene: int) -> tuple[str, int]:
        """Return the operand of an op-code that an operand byte `gene` selects: ("register" or "row", number).

        The op-code ``input`` takes an input or constant, ``load`` and ``store`` a register. A binary operator takes a
        register or, with ``direct`` and an odd byte, an input or constant.
        """
        registers = len(self.start)
        if code == INPUT:
            return "row", self.element_row(gene % self.elements)
        if code in (LOAD, STORE) or not self.direct:
            return "register", gene % registers
        half, odd = divmod(gene, 2)
        return ("row", self.element_row(half % self.elements)) if odd else ("register", half % registers)

    @cached_property
    def tables(self) -> Tables:
        """Tables from which the compiled loops decode programs."""
        registers = len(self.start)
        alone = [code for code, operator in BY_CODE.items() if operator.arity == 1]
        op_codes = self.opcode_table.astype(np.uint16) * np.uint16(256)
        operands = np.full((max(BY_CODE) + 1, 256), registers, dtype=np.uint16)
        for code in [INPUT, LOAD, STORE, *BY_CODE.keys() - alone]:
            for gene in range(256):
                kind, number = self.operand(code, gene)
                operands[code, gene] = number if kind == "register" else registers + number
        cells, codes = operands.ravel().astype(np.uint32), np.arange(operands.size) >> 8
        bits = np.where(cells < registers, np.uint32(1) << np.minimum(cells, 31), 0).astype(np.uint32)
        reads = np.where(codes == STORE, np.uint32(0), bits) | np.where(codes >= STORE, ACCUMULATOR, np.uint32(0))
        start = [self.zero_row if name is None else self.inputs.index(name) for name in self.start]
        typing, row_kinds = Typing(self.kinds), np.zeros(self.base + self.own_constants, dtype=np.uint8)
        row_kinds[: len(self.kinds)] = typing.of_inputs
        return Tables(
            op_codes + ~np.isin(self.opcode_table, alone) * np.uint16(255),
            operands.ravel(),
            np.where(codes == STORE, bits, ACCUMULATOR).astype(np.uint32),
            reads.astype(np.uint32),
            np.array(start, dtype=np.uint16),
            typing.repairs(self.operators),
            np.concatenate([row_kinds[start], row_kinds]),
            self.base,
        )
