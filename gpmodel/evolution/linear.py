"""The linear sequence: a fixed-length array of operators and operands on an accumulator machine.

Thesis section 5.2.2, Table 5.1 and Figs 5.3 to 5.5. The accumulator starts as register 0 does; an operator
that takes an operand and stands at the very end is dropped.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.machine import Layout
from gpmodel.evolution.population import Sequences
from gpmodel.evolution.threads import over_slices
from gpmodel.formula.operators import BY_CODE, INPUT, LOAD, STORE
from gpmodel.formula.program import Builder, Program

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SequenceBreeding:
    """How sequences are made and varied (Fig 5.3).

    While a child is copied, each element switches to the other parent at rate ``crossover`` and is replaced
    by a random one at rate ``mutation``.
    """

    layout: Layout
    length: int = 160
    crossover: float = 0.01
    mutation: float = 0.01
    threads: int = 1

    def initial(self, population: int, rng: np.random.Generator) -> Sequences:
        """Uniform genes; own constants standard normal."""
        genes = rng.integers(0, 256, (population, self.length), dtype=np.uint8)
        return Sequences(genes, rng.normal(size=(population, self.layout.own_constants)))

    def offspring(
        self, parents: Sequences, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Sequences:
        """One child a pair of parents, each from a random stream of its own."""
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
    """Op-codes with their operand genes, as in Fig 5.4: ``[0 0 2 6 16]`` gives (0, 0), (2, 6), (16, None)."""
    found: list[tuple[int, int | None]] = []
    pending = iter(int(gene) for gene in genes)
    for gene in pending:
        code = int(layout.operator_of[gene])
        if code in BY_CODE and BY_CODE[code].arity == 1:
            found.append((code, None))
        elif (operand := next(pending, None)) is not None:
            found.append((code, operand))
    return found


def program_of(genes: NDArray[np.uint8], constants: Array, layout: Layout) -> Program:
    """The effective code of one sequence as a Program with ``layout.outputs`` outputs."""
    builder = Builder()

    def row(index: int) -> int:
        if index < len(layout.inputs):
            return builder.input(layout.inputs[index])
        if index > layout.zero_row:
            return builder.constant(float(constants[index - layout.base]))
        return builder.constant([*layout.constants, 0.0][index - len(layout.inputs)])

    registers = [row(int(index)) for index in layout.start_rows]
    accumulator = registers[0]
    for code, operand in instructions(genes, layout):
        if operand is None:
            accumulator = builder.apply(BY_CODE[code].name, accumulator)
            continue
        kind, number = layout.operand(code, operand)
        if code == STORE:
            registers[number] = accumulator
            continue
        value = registers[number] if kind == "register" else row(number)
        accumulator = value if code in (INPUT, LOAD) else builder.apply(BY_CODE[code].name, accumulator, value)
    return builder.program(registers[: layout.outputs])
