"""Kinds of physical quantities and the operations allowed on each kind: strongly typed programs (Montana 1995).

Kinds of inputs: "angle", "short angle" (its range is too short for its period to matter), "time" and "row" (clocks),
"number" (dimensionless), and any other name, which is a quantity by itself: "length", "torque", "temperature". Angles
may be arguments of periodic functions and of functions of the distance from a given angle, and may be added and
subtracted. A quantity may be added only to a quantity of its own kind. Clocks may enter ramps, steps and exponential
approaches. A threshold in a formula counts as a constant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpmodel.formula.operators import ARITHMETIC, BY_CODE, Operator
from gpmodel.formula.program import Program

ANY, CONSTANT, NUMBER = "any", "constant", "number"
ANGLE, SHORT, BENT, SQUARE = "angle", "short angle", "bent angle", "squared angle"
CLOCKS = ("time", "row")
SHORT_RANGE = np.pi / 2
"""Range below which an angle, rad, counts as a short angle: the angle's sine is a straight line to 10 %, or a parabola
to 3 %."""

_SATURATING = ("tanh", "atan")
_UNARY: dict[str, dict[str, str]] = {
    ANGLE: {**dict.fromkeys(("sin", "cos", "tan", *_SATURATING), NUMBER), "abs": BENT, "square": SQUARE},
    SHORT: {**dict.fromkeys(("sin", "cos", "tan", *_SATURATING, "square"), NUMBER), "abs": BENT},
    BENT: {**dict.fromkeys(_SATURATING, NUMBER), "abs": BENT, "square": SQUARE},
    SQUARE: {"exp": NUMBER},
    NUMBER: dict.fromkeys(("abs", "square", "sqrt", "log", "asin", "reciprocal"), NUMBER),
    "clock": dict.fromkeys((*_SATURATING, "exp"), NUMBER),
    "quantity": {**dict.fromkeys((*_SATURATING, "exp", "square", "sqrt", "log"), NUMBER), "abs": "quantity"},
}


def role(kind: str) -> str:
    """Return the name of a kind of quantity in the typing rules: "clock", the kind itself, or "quantity"."""
    if kind in CLOCKS:
        return "clock"
    return kind if kind in _UNARY or kind == CONSTANT else "quantity"


def result(operator: str, *kinds: str) -> str | None:
    """Return the kind of quantity that an operator gives, or None if the operator does not apply to the given kinds."""
    if ANY in kinds:
        return ANY
    if all(kind == CONSTANT for kind in kinds):
        return None
    if len(kinds) == 1:
        found = _UNARY[role(kinds[0])].get(operator)
        return kinds[0] if found == "quantity" else found
    if CONSTANT in kinds:
        return _beside_a_constant(operator, *kinds)
    return _of_two(operator, *kinds)


def _beside_a_constant(operator: str, first: str, second: str) -> str | None:
    kind = second if first == CONSTANT else first
    if operator == "divide" and first == CONSTANT:
        return NUMBER if kind == NUMBER else None
    if operator in ("min", "max"):
        return BENT if kind in (ANGLE, SHORT) else None if kind == SQUARE else kind
    return kind if operator in ("add", "subtract", "multiply", "divide") else None


def _of_two(operator: str, first: str, second: str) -> str | None:
    roles = {role(first), role(second)}
    if operator in ("add", "subtract"):
        if roles <= {ANGLE, SHORT, BENT}:
            return first if first == second else BENT if BENT in roles else ANGLE
        return first if first == second and roles <= {NUMBER, "quantity"} else None
    if operator == "multiply":
        direct = roles <= {NUMBER, "quantity", SHORT, "clock"} and roles != {"clock"}
        return NUMBER if direct or (NUMBER in roles and roles <= {NUMBER, ANGLE, BENT}) else None
    if operator == "divide":
        same = first == second and roles <= {NUMBER, "quantity"}
        return NUMBER if same or (role(first) == "quantity" and second == NUMBER) else None
    return None


NONE = 255
"""Number that means "no kind of physical quantity"."""


@dataclass(frozen=True)
class Typing:
    """Indices of all kinds of quantities that can arise from the inputs; without ``inputs`` anything is allowed."""

    inputs: tuple[str, ...] = ()

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Names of all kinds of quantities, by index; constants have the index 0."""
        made = (CONSTANT, NUMBER, BENT, SQUARE, *self.inputs) if self.inputs else (ANY,)
        return tuple(dict.fromkeys(made))

    @cached_property
    def of_inputs(self) -> NDArray[np.uint8]:
        """Index of the kind of quantity of each input; empty if the inputs have no kinds."""
        return np.array([self.kinds.index(kind) for kind in self.inputs], dtype=np.uint8)

    @cached_property
    def results(self) -> dict[str, NDArray[np.uint8]]:
        """Kind number of each operator's result for every kind of its argument, or every pair of kinds of its two
        arguments. An operation that is not allowed has the number ``NONE``."""
        found = {}
        for operator in ARITHMETIC:
            table = np.full((len(self.kinds),) * operator.arity, NONE, dtype=np.uint8)
            for place in np.ndindex(table.shape):
                kind = result(operator.name, *(self.kinds[k] for k in place))
                if kind is not None:
                    table[place] = self.kinds.index(kind)
            found[operator.name] = table
        return found

    def repairs(self, operators: Sequence[Operator]) -> NDArray[np.uint16]:
        """Return the operator that replaces each operator, for every pair of kinds of quantities of its arguments.

        An entry is 256 * op-code + index of the result's kind. An allowed operator is replaced by itself. An operator
        that is not allowed is replaced by the next allowed operator with as many arguments; 0 if there is none. Table:
        (op-codes, kind of the first argument, kind of the second argument or 0), empty without kinds.
        """
        count = len(self.kinds) if self.inputs else 0
        table = np.zeros((max(BY_CODE) + 1, count, count), dtype=np.uint16)
        for arity in (1, 2):
            offered = [operator for operator in operators if operator.arity == arity]
            for place, asked in enumerate(offered):
                for other in reversed(offered[place:] + offered[:place]):
                    made = self.results[other.name].astype(np.uint16)
                    made = made[:, None] if arity == 1 else made
                    part = table[asked.code, :, : made.shape[1]]
                    part[...] = np.where(made != NONE, 256 * other.code + made, part)
        return table

    def allows(self, program: Program, names: Sequence[str]) -> bool:
        """Return whether every operation of a program is allowed, given the names of its inputs."""
        found: list[int] = []
        for node in program.nodes:
            if node.operator == "input":
                found.append(int(self.of_inputs[names.index(str(node.value))]) if self.inputs else 0)
            elif node.operator == "constant":
                found.append(0)
            else:
                found.append(int(self.results[node.operator][tuple(found[k] for k in node.arguments)]))
                if found[-1] == NONE:
                    return False
        return True
