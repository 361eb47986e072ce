"""Linear sequence: a program that is a fixed-length array of operators and operands for an accumulator machine.

Source: thesis section 5.2.2, Table 5.1 and Figs 5.3 to 5.5. The accumulator starts with the value of register 0. An
operator at the very end that lacks its operand is dropped.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.engine import Code, empty_code, over_slices
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.representation import Population, check_ranges
from gpmodel.formula.operators import BY_CODE, INPUT, LOAD, STORE, TABLE_CONSTANTS, operator_set
from gpmodel.formula.program import Builder, Program


@dataclass(frozen=True)
class Linear:
    """Settings of programs that are sequences of ``length`` instruction bytes (genes) on registers.

    operators: name of a set (``gpmodel.formula.operators.SETS``), or names of operators.
    constants: fixed constants that every program may use.
    own_constants: number of further constants that each program carries.
    registers, outputs: number of registers; number of registers whose final values are basis functions.
    start_inputs: whether registers start with the inputs in turn rather than with 0.
    direct: whether binary operators may take an input or constant as well as a register.
    crossover, mutation: rates per gene (Fig 5.3 of the thesis).
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

    def breeding(self, inputs: Inputs, start: tuple[str, ...], threads: int) -> "SequenceBreeding":
        first: list[str | None] = [*start]
        if not first and self.start_inputs:
            first = [inputs.names[k % len(inputs.names)] for k in range(self.registers)]
        first = (first + [None] * self.registers)[: max(self.registers, self.outputs)]
        layout = Layout(
            inputs.names, operator_set(self.operators), self.constants, tuple(first), self.outputs,
            self.own_constants, self.direct, inputs.kinds,
        )  # fmt: skip
        return SequenceBreeding(layout, self.length, self.crossover, self.mutation, threads)


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

    def decoder(self, layout: Layout) -> Callable[[slice], Code]:
        return partial(self._decoded, layout)

    def _decoded(self, layout: Layout, part: slice) -> Code:
        from gpmodel.evolution.kernels.batch import decode_sequences

        longest = self.genes.shape[1] + layout.own_constants + 1
        code = empty_code(np.ascontiguousarray(self.constants[part]), longest, layout.outputs)
        decode_sequences(
            self.genes[part], code.constants.view(np.uint64), layout.op_codes, layout.operand_table, layout.read_mask,
            layout.write_mask, layout.start_rows, layout.replacements, layout.cell_kinds, layout.base,
            code.words, code.outputs, code.count, code.nodes, code.hashes,
        )  # fmt: skip
        return code

    def program(self, row: int, layout: Layout) -> Program:
        return program_of(self.genes[row], self.constants[row], layout)

    def constants_of(self, row: int) -> Array:
        return np.array(self.constants[row])

    def with_constants(self, row: int, values: Array) -> "Sequences":
        return Sequences(self.genes[row : row + 1], values[None, :])


@dataclass(frozen=True)
class SequenceBreeding:
    """Creation and variation of linear sequences (thesis Fig 5.3).

    While a child is copied, each element switches to the other parent at rate ``crossover`` and is replaced by a random
    element at rate ``mutation``.
    """

    layout: Layout
    length: int = 160
    crossover: float = 0.01
    mutation: float = 0.01
    threads: int = 1

    def initial(self, population: int, rng: np.random.Generator) -> Sequences:
        """Return sequences of uniform random bytes, which carry constants with a standard normal distribution."""
        genes = rng.integers(0, 256, (population, self.length), dtype=np.uint8)
        return Sequences(genes, rng.normal(size=(population, self.layout.own_constants)))

    def offspring(
        self, parents: Population, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Sequences:
        assert isinstance(parents, Sequences), "sequences are bred from sequences"
        from gpmodel.evolution.kernels.breeding import breed_sequences

        seed = rng.integers(2**63, dtype=np.uint64)
        genes = np.empty((len(mothers), self.length), dtype=np.uint8)
        constants = np.empty((len(mothers), self.layout.own_constants))

        def work(part: slice) -> None:
            breed_sequences(
                parents.genes, parents.constants, mothers[part], fathers[part], seed, part.start,
                self.crossover, self.mutation, genes[part], constants[part],
            )  # fmt: skip

        over_slices(len(mothers), self.threads, work)
        return Sequences(genes, constants)


def instructions(genes: NDArray[np.uint8], layout: Layout) -> list[tuple[int, int | None]]:
    """Return op-codes with their operand bytes, as in Fig 5.4: ``[0 0 2 6 16]`` gives (0, 0), (2, 6), (16, None)."""
    found: list[tuple[int, int | None]] = []
    pending = iter(int(gene) for gene in genes)
    for gene in pending:
        code = int(layout.opcode_table[gene])
        if code in BY_CODE and BY_CODE[code].arity == 1:
            found.append((code, None))
        elif (operand := next(pending, None)) is not None:
            found.append((code, operand))
    return found


def program_of(genes: NDArray[np.uint8], constants: Array, layout: Layout) -> Program:
    """Return the effective code (instructions that reach an output) of one sequence as a Program. An operator that is
    not allowed for its kinds of arguments is replaced or left out."""
    builder = Builder()

    def row(index: int) -> int:
        if index < len(layout.inputs):
            return builder.input(layout.inputs[index])
        if index > layout.zero_row:
            return builder.constant(float(constants[index - layout.base]))
        return builder.constant([*layout.constants, 0.0][index - len(layout.inputs)])

    def typed(index: int) -> tuple[int, int]:
        return row(index), int(layout.cell_kinds[len(layout.start) + index])

    registers = [typed(int(index)) for index in layout.start_rows]
    accumulator = registers[0]
    for code, operand in instructions(genes, layout):
        value = None
        if operand is not None:
            where, number = layout.operand(code, operand)
            if code == STORE:
                registers[number] = accumulator
                continue
            value = registers[number] if where == "register" else typed(number)
            if code in (INPUT, LOAD):
                accumulator = value
                continue
        kind = 0
        if layout.kinds:
            code, kind = divmod(int(layout.replacements[code, accumulator[1], value[1] if value else 0]), 256)
        if code:
            arguments = (accumulator[0], value[0]) if value else (accumulator[0],)
            accumulator = builder.apply(BY_CODE[code].name, *arguments), kind
    return builder.program(node for node, _ in registers[: layout.outputs])
