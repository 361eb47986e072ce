"""Bases: the shape of an effect as a function of the pose's states."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program, length

LARGEST_WRITTEN = 50_000
"""Parts of a basis with every name replaced by what it stands for; each name may double it."""


class Columns(Protocol):
    """Named columns (N,), one value a pose; its length is N."""

    def __getitem__(self, name: str, /) -> Array: ...
    def __len__(self) -> int: ...


class Basis(Protocol):
    """A shape φ(s). `str(basis)` is its expression; `inputs` are the state columns it reads."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The state columns that it reads, in the order of their first mention."""

    def __call__(self, states: Columns) -> Array:
        """Values (N,) at the poses of `states`."""


@dataclass(frozen=True)
class Expression:
    """A basis written as text, `sin(2*J4)`: a program of one output over state columns.

    What may be written and what it means is said by `gpmodel.formula.parse` and `gpmodel.formula.operators`. Raises
    InputError for anything else: the text is read, never executed.
    """

    text: str

    def __post_init__(self) -> None:
        if not isinstance(self.text, str):
            raise InputError(f"a {type(self.text).__name__} is no expression; write for example 'sin(2*J4)'", "text")
        _parsed(self.text)

    @property
    def program(self) -> Program:
        """The program that the text stands for; equal parts of it are one node."""
        return _parsed(self.text)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """The state columns that it reads, in the order of their first mention."""
        return tuple(str(node.value) for node in self.program.nodes if node.operator == "input")

    @cached_property
    def length(self) -> int:
        """Operators, inputs and constants that it is written with, as in `gpmodel.formula.program`."""
        return length(self.program)

    @cached_property
    def call(self) -> tuple[str, str]:
        """Name and argument of the function that it is a call of, `sin` and `2*J4`; both empty where it is none."""
        program = self.program
        last = program.nodes[program.outputs[0]]
        if len(last.arguments) != 1:
            return "", ""
        return last.operator, Program(program.nodes, last.arguments).written_out()

    def __call__(self, states: Columns) -> Array:
        value = self.program.values(states, len(states))[self.program.outputs[0]]
        return value if value.shape == (len(states),) else np.broadcast_to(value, (len(states),))

    def __str__(self) -> str:
        return self.text


@lru_cache(maxsize=1 << 16)
def _parsed(text: str) -> Program:
    """The program of a text; thousands of candidates are written anew in every round."""
    program = parse(text, "basis")
    if len(program.outputs) != 1:
        raise InputError(f"basis {text!r}: {len(program.outputs)} values, expected one; write for example sin(2*J4)")
    sizes = list[int]()
    for node in program.nodes:
        sizes.append(1 + sum(sizes[k] for k in node.arguments))
    if sizes[program.outputs[0]] > LARGEST_WRITTEN:
        raise InputError(f"basis {text[:40]!r}…: more than {LARGEST_WRITTEN} parts when it is written out")
    return program


ONE = Expression("1")
