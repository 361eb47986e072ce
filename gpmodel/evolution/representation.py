"""Interfaces of a representation of programs: encoding, creation and variation."""

from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.code import Code
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import Inputs
from gpmodel.formula.operators import BY_CODE
from gpmodel.formula.program import Builder, Program

Rows = NDArray[np.intp]


class Population(Protocol):
    """A population of programs in one representation, numbered by row."""

    def __len__(self) -> int: ...

    def take(self, rows: Rows) -> Self:
        """Return the programs of a population with the given row numbers."""

    def join(self, other: Self) -> Self:
        """Return the programs of this population followed by the programs of ``other``."""

    def decoded(self, layout: Layout, part: slice) -> Code:
        """Return the effective code of a slice of the programs."""


@runtime_checkable
class Representation(Protocol):
    """Settings of a representation of programs, such as ``Linear`` and ``Tree``, which creates and varies programs."""

    @property
    def constants(self) -> tuple[float, ...]:
        """Constants that every program may use and that are never fitted."""

    def layout(self, inputs: Inputs, start: tuple[str, ...]) -> Layout:
        """Return the registers and instructions from which the compiled loops decode programs. start: first values of
        outputs (compensator: x, y, z)."""

    def initial(self, layout: Layout, population: int, rng: np.random.Generator) -> Population:
        """Return a random population of programs."""

    def offspring(
        self, layout: Layout, parents: Population, mothers: Rows, fathers: Rows, rng: np.random.Generator
    ) -> Population:
        """Return one child per pair of rows of ``parents``, a population in this representation."""


def program_of(population: Population, row: int, layout: Layout) -> Program:
    """Return the program at `row` of a population, with ``layout.outputs`` outputs, from its effective code."""
    from gpmodel.evolution.kernels.machine import CONSTANT, ROW

    code, builder = population.decoded(layout, slice(row, row + 1)), Builder()
    rows = [*map(builder.input, layout.inputs), *map(builder.constant, (*layout.constants, 0.0))]
    for word in code.words[0, : code.length[0]].tolist():
        number, first, second = word & ROW, word >> 16 & ROW, word >> 32
        if number == CONSTANT:
            rows.append(builder.constant(float(code.constants[0, first])))
        else:
            operator = BY_CODE[number]
            rows.append(builder.apply(operator.name, *(rows[k] for k in (first, second)[: operator.arity])))
    return builder.program(rows[k] for k in code.outputs[0].tolist())


def label(representation: Representation) -> str:
    """Return the name of a representation in runs, histograms and files: its class name in lower case."""
    return type(representation).__name__.lower()


def check_ranges(choices: object, **limits: tuple[float, float]) -> None:
    """Raise InputError for a setting outside its closed range (least, most)."""
    for name, (least, most) in limits.items():
        value = getattr(choices, name)
        if not isinstance(value, int | float) or not least <= value <= most:
            raise InputError(f"{value}, expected {least:g} to {most:g}", name)
