"""Linear sequence: a program that is a fixed-length array of operators and operands for an accumulator machine.

Source: Robertson (2003), 5.2.2, Table 5.1, Figs 5.3 to 5.5. The accumulator starts with the value of register 0. An
operator at the very end that lacks its operand is dropped.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.code import Code
from gpmodel.evolution.engine import empty_code
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.representation import Population, check_ranges
from gpmodel.formula.operators import TABLE_CONSTANTS, operator_set


@dataclass(frozen=True)
class Linear:
    """Settings of programs that are sequences of ``length`` instruction bytes (genes) on registers.

    operators: name of a set (``gpmodel.formula.operators.SETS``), or names of operators.
    constants: fixed constants that every program may use.
    own_constants: number of further constants that each program carries.
    registers, outputs: number of registers; number of registers whose final values are basis functions.
    start_inputs: whether registers start with the inputs in turn rather than with 0.
    direct: whether binary operators may take an input or constant as well as a register.
    crossover, mutation: rates per gene (Robertson 2003, Fig 5.3).
    Raises InputError for a value out of range.
    """

    length: int = 40
    registers: int = 4
    outputs: int = 3
    operators: str | tuple[str, ...] = "slot"
    constants: tuple[float, ...] = (1.0, 2.0)
    own_constants: int = 4
    start_inputs: bool = True
    direct: bool = True
    crossover: float = 0.03
    mutation: float = 0.05

    def __post_init__(self) -> None:
        check_ranges(
            self, length=(2, 4096), registers=(1, 31), outputs=(1, 8), own_constants=(0, 64),
            crossover=(0.0, 0.999), mutation=(0.0, 0.999),
        )  # fmt: skip
        if self.outputs > self.registers:
            raise InputError(f"outputs: {self.outputs}, but there are {self.registers} registers")
        operator_set(self.operators)

    @staticmethod
    def thesis() -> "Linear":
        """Return the settings of section 5.2.2: 160 elements, operators and constants of Table 5.1, rates of 1 %."""
        return Linear(
            length=160, registers=8, outputs=3, operators="thesis", constants=TABLE_CONSTANTS, own_constants=0,
            start_inputs=False, direct=False, crossover=0.01, mutation=0.01,
        )  # fmt: skip

    def layout(self, inputs: Inputs, start: tuple[str, ...]) -> Layout:
        first: list[str | None] = [*start]
        if not first and self.start_inputs:
            first = [inputs.names[k % len(inputs.names)] for k in range(self.registers)]
        first = (first + [None] * self.registers)[: max(self.registers, self.outputs)]
        return Layout(
            inputs.names, operator_set(self.operators), self.constants, tuple(first), self.outputs,
            self.own_constants, self.direct, inputs.kinds,
        )  # fmt: skip

    def initial(self, layout: Layout, population: int, rng: np.random.Generator) -> "Sequences":
        """Return sequences of uniform random bytes, which carry constants with a standard normal distribution."""
        genes = rng.integers(0, 256, (population, self.length), dtype=np.uint8)
        return Sequences(genes, rng.normal(size=(population, self.own_constants)))

    def offspring(
        self, layout: Layout, parents: Population, mothers: NDArray[np.intp], fathers: NDArray[np.intp],
        rng: np.random.Generator,
    ) -> "Sequences":  # fmt: skip
        """Return child programs (Robertson 2003, Fig 5.3). While a child is copied, each element switches to the other
        parent at rate ``crossover`` and is replaced by a random element at rate ``mutation``."""
        assert isinstance(parents, Sequences), "sequences are bred from sequences"
        from gpmodel.evolution.kernels.breeding import breed_sequences

        seed = rng.integers(2**63, dtype=np.uint64)
        genes = np.empty((len(mothers), self.length), dtype=np.uint8)
        constants = np.empty((len(mothers), self.own_constants))
        breed_sequences(
            parents.genes, parents.constants, mothers, fathers, seed, self.crossover, self.mutation, genes, constants
        )
        return Sequences(genes, constants)


@dataclass(frozen=True)
class Sequences:
    """A population of linear sequences. genes: bytes (programs, length). constants: (programs, constants) of each."""

    genes: NDArray[np.uint8]
    constants: Array

    def __len__(self) -> int:
        return len(self.genes)

    def take(self, rows: NDArray[np.intp]) -> "Sequences":
        return Sequences(self.genes[rows], self.constants[rows])

    def join(self, other: "Sequences") -> "Sequences":
        return Sequences(np.concatenate([self.genes, other.genes]), np.concatenate([self.constants, other.constants]))

    def decoded(self, layout: Layout, part: slice) -> Code:
        from gpmodel.evolution.kernels.batch import decode_sequences

        longest = self.genes.shape[1] + layout.own_constants + 1
        code = empty_code(np.ascontiguousarray(self.constants[part]), longest, layout.outputs)
        decode_sequences(self.genes[part], layout.tables, code)
        return code
