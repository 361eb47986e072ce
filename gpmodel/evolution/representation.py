"""Interface of a representation: encoding, initialisation and variation of programs."""

from collections.abc import Callable
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.engine import Code
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import Inputs
from gpmodel.formula.program import Program

Rows = NDArray[np.intp]


class Population(Protocol):
    """Programs in one representation; rows are their numbers."""

    def __len__(self) -> int: ...

    def take(self, rows: Rows) -> Self:
        """The programs at some rows."""

    def join(self, other: Self) -> Self:
        """These programs followed by others."""

    def decoder(self, layout: Layout) -> Callable[[slice], Code]:
        """A function from a slice of rows to their effective code; threads call it side by side."""

    def program(self, row: int, layout: Layout) -> Program:
        """One of them as a program of ``layout.outputs`` outputs."""

    def constants_of(self, row: int) -> Array:
        """Own constants of one program."""

    def with_constants(self, row: int, values: Array) -> Self:
        """The one program at ``row`` with other own constants."""


class Breeding(Protocol):
    """A representation made ready for one problem: how its programs start and vary."""

    @property
    def layout(self) -> Layout:
        """Registers and instructions that the kernels decode its programs by."""

    def initial(self, population: int, rng: np.random.Generator) -> Population:
        """A random population."""

    def offspring(self, parents: Population, mothers: Rows, fathers: Rows, rng: np.random.Generator) -> Population:
        """One child a pair of rows of ``parents``, which are of its own representation."""


@runtime_checkable
class Representation(Protocol):
    """The choices of a representation, ``Linear`` and ``Tree`` among them."""

    @property
    def constants(self) -> tuple[float, ...]:
        """Constants that every program may read and that are never fitted."""

    def breeding(self, inputs: Inputs, start: tuple[str, ...], threads: int) -> Breeding:
        """Ready for these inputs; ``start`` are those that outputs begin from (a compensator's x, y, z)."""


def label(representation: Representation) -> str:
    """The name that runs, histograms and files use: that of its class, in small letters."""
    return type(representation).__name__.lower()


def check_ranges(choices: object, **limits: tuple[float, float]) -> None:
    """Raises InputError for a choice out of its range, ends included."""
    for name, (least, most) in limits.items():
        value = getattr(choices, name)
        if not isinstance(value, int | float) or not least <= value <= most:
            raise InputError(f"{value}, expected {least:g} to {most:g}", name)
