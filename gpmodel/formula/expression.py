"""Basis functions: the dependence of an effect on the state of the pose, read from text."""

import ast
import sys
import threading
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.formula.operators import BY_NAME
from gpmodel.formula.program import Builder, Program, length

_BINARY: dict[type, str] = {
    ast.Add: "add",
    ast.Sub: "subtract",
    ast.Mult: "multiply",
    ast.Div: "divide",
    ast.Mod: "modulo",
    ast.Pow: "power",
}

LARGEST_NUMBER = sys.float_info.max
DIGITS = 6
"""Significant digits of a written constant: an error of a millionth is far below the standard error of a constant."""
LONGEST_TEXT = 50_000
"""Largest number of characters of a formula. The longest evolved one, of 256 instructions, has 10 000 characters."""
MOST_PARTS = 5_000
"""Largest number of operators, inputs and numbers of a formula."""
DEEPEST = 300
"""Largest nesting depth of a formula: that of an evolved sequence of 256 instructions, each result used once."""
_ALONE = threading.RLock()
"""Lock held while a text is parsed: Python 3.11 counts the depth of syntax trees for all threads together."""


def parse(text: str, what: str = "program") -> Program:
    """Parse a text such as ``v1 = sin(J1); v1*v1 + 2*'oil temperature', v1`` into a program, without executing it.

    Functions have the names of the operators. ``x**n`` with a whole n becomes a product; any other power is ``power``.
    A quoted text is an input whose name is no identifier. Raises InputError with the part that cannot be parsed. what:
    name of the text in the message.
    """
    if len(text) > LONGEST_TEXT:
        raise InputError(f"{what} {text[:40]!r}…: {len(text)} characters, expected at most {LONGEST_TEXT}")
    try:
        with _ALONE:
            statements = ast.parse(text.strip()).body
    except SyntaxError as error:
        raise InputError(
            f"{what} {_short(text)}: {error.msg} near column {error.offset}; expected for example sin(2*J4)"
        ) from None
    except (ValueError, RecursionError, MemoryError):
        raise InputError(f"{what} {_short(text)}: expected an expression, for example sin(2*J4)") from None
    _check_size(statements, f"{what} {_short(text)}")
    if not statements:
        raise InputError(f"{what} {_short(text)}: expected an expression, for example sin(2*J4)")
    try:
        return _read(statements, f"{what} {_short(text)}")
    except RecursionError:
        raise InputError(
            f"{what} {_short(text)}: too many nested parentheses; expected at most {DEEPEST} levels"
        ) from None


def _read(statements: list[ast.stmt], whole: str) -> Program:
    reader = _Reader(whole)
    for statement in statements[:-1]:
        if not (isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)):
            raise InputError(f"{whole}: expected 'name = expression' before the last ';'")
        reader.names[statement.targets[0].id] = reader.read(statement.value)
    expression = statements[-1]
    if not isinstance(expression, ast.Expr):
        raise InputError(f"{whole}: expected an expression at the end, for example sin(2*J4)")
    last = expression.value
    outputs = last.elts if isinstance(last, ast.Tuple) else [last]
    return reader.builder.program([reader.read(output) for output in outputs])


def _short(text: str) -> str:
    """Return a text in quotes, shortened to 200 characters, for a message."""
    return repr(text) if len(text) <= 200 else f"{text[:200]!r}…"


def _check_size(statements: list[ast.stmt], whole: str) -> None:
    """Raise InputError if a text has too many parts or too deep a nesting."""
    level: list[ast.AST] = list(statements)
    depth = parts = 0
    while level:
        depth, parts = depth + 1, parts + len(level)
        level = [n for node in level for n in ast.iter_child_nodes(node) if isinstance(n, ast.expr)]
        if depth > DEEPEST or parts > MOST_PARTS:
            raise InputError(f"{whole}: expected at most {MOST_PARTS} parts and {DEEPEST} nested levels")


class _Reader:
    def __init__(self, whole: str) -> None:
        self.whole = whole
        self.builder = Builder()
        self.names: dict[str, int] = {}

    def read(self, node: ast.expr) -> int:
        """Parse a part of the text and return the number of the program's node that computes this part."""
        match node:
            case ast.Constant(value=str() as name):
                return self.builder.input(name)
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return self.number(value)
            case ast.Name(id=name):
                return self.names[name] if name in self.names else self.builder.input(name)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.read(operand)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return self.number(-value)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.builder.apply("multiply", self.number(-1.0), self.read(operand))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.builder.apply("not", self.read(operand))
            case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int() as power)) if 0 < power < 65:
                return raise_to(self.builder, self.read(base), power)
            case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _BINARY:
                return self.builder.apply(_BINARY[type(operation)], self.read(left), self.read(right))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in BY_NAME:
                return self.call(name, arguments)
        said = ast.unparse(node)
        raise InputError(
            f"{self.whole}: cannot read {said!r}; expected numbers, inputs and the functions "
            f"{choices(said.split('(')[0], BY_NAME)}"
        )

    def number(self, value: float) -> int:
        """Return the number of the program's node for a constant. Raises InputError if the constant is too large."""
        if abs(value) > LARGEST_NUMBER:
            raise InputError(f"{self.whole}: a number is too large, expected at most {LARGEST_NUMBER:g}")
        return self.builder.constant(float(value))

    def call(self, name: str, arguments: list[ast.expr]) -> int:
        """Return the number of the program's node for a function call. Raises InputError for wrong arguments."""
        if len(arguments) != BY_NAME[name].arity:
            raise InputError(f"{self.whole}: {len(arguments)} arguments of {name}, expected {BY_NAME[name].arity}")
        return self.builder.apply(name, *(self.read(argument) for argument in arguments))


def raise_to(builder: Builder, base: int, power: int) -> int:
    """Append nodes that compute ``base**power`` by squaring, power a whole number above 0; return the node index."""
    if power == 1:
        return base
    half = raise_to(builder, base, power // 2)
    squared = builder.apply("square", half)
    return builder.apply("multiply", squared, base) if power % 2 else squared


LARGEST_WRITTEN = 50_000
"""Largest number of parts of a basis function after names are replaced by definitions; each name may double it."""


class Columns(Protocol):
    """Interface of named columns with one value per pose. The length of the object is the number of poses."""

    def __getitem__(self, name: str, /) -> Array: ...
    def __len__(self) -> int: ...


class Basis(Protocol):
    """Interface of a basis function of the columns of a pose. `str(basis)` is its expression as text."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the state columns in the expression, in the order of first use."""

    def __call__(self, states: Columns) -> Array:
        """Return the value of the basis function at each pose of `states`."""


@dataclass(frozen=True)
class Expression:
    """A basis function written as text, such as `sin(2*J4)`: a program of one output over state columns.

    `gpmodel.formula.expression.parse` states the syntax, `gpmodel.formula.operators` the functions. Raises InputError
    for an invalid text. The text of a formula is parsed, never executed.
    """

    text: str

    def __post_init__(self) -> None:
        if not isinstance(self.text, str):
            raise InputError(
                f"a {type(self.text).__name__} is not an expression; expected a text, for example 'sin(2*J4)'", "text"
            )
        _parsed(self.text)

    @property
    def program(self) -> Program:
        """The program (graph of operators) of the expression's text, with equal subexpressions merged into one node."""
        return _parsed(self.text)

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.program.read

    @cached_property
    def length(self) -> int:
        """Number of operators, inputs and constants; an input with an offset and a scale counts as one input."""
        return length(self.program)

    @cached_property
    def call(self) -> tuple[str, str]:
        """Name and argument of the outermost function of the expression, such as `sin` and `2*J4`; empty if the
        expression has no function."""
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
    """Return the program of a text. Programs are cached, because each round writes thousands of candidates again."""
    program = parse(text, "basis")
    if len(program.outputs) != 1:
        raise InputError(f"basis {text!r}: {len(program.outputs)} values; expected one, for example sin(2*J4)")
    sizes = list[int]()
    for node in program.nodes:
        sizes.append(1 + sum(sizes[k] for k in node.arguments))
    if sizes[program.outputs[0]] > LARGEST_WRITTEN:
        raise InputError(
            f"basis {text[:40]!r}…: more than {LARGEST_WRITTEN} parts after named parts are inserted; expected fewer"
        )
    return program


ONE = Expression("1")
