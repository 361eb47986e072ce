"""Bases: the shape of an effect as a function of the pose's states."""

import ast
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.operators import ARITHMETIC

_FUNCTIONS: dict[str, Any] = {
    **{o.name: o.function for o in ARITHMETIC if o.name != "not"},
    "sign": np.sign,
    "step": lambda x: (x > 0) * 1.0,
}
_NODES = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Constant, ast.Load,
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.Mod, ast.USub, ast.UAdd,
)  # fmt: skip


class Columns(Protocol):
    """Named columns (N,), one value a pose; its length is N."""

    def __getitem__(self, name: str) -> Array: ...
    def __len__(self) -> int: ...


class Basis(Protocol):
    """A shape φ(s). `str(basis)` is its expression; `inputs` are the state columns it reads."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The state columns that it reads, in the order of their first mention."""
        ...

    def __call__(self, states: Columns) -> Array:
        """Values (N,) at the poses of `states`."""
        ...


@dataclass(frozen=True)
class Expression:
    """A basis written as text, `sin(2*J4)`: arithmetic and a closed list of functions over state columns.

    Raises InputError for anything else: the text is parsed, never executed.
    """

    text: str

    def __post_init__(self) -> None:
        _parsed(self.text)

    @property
    def _tree(self) -> ast.Expression:
        return _parsed(self.text)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """The state columns that it reads, in the order of their first mention."""
        names = [n.id for n in ast.walk(self._tree) if isinstance(n, ast.Name) and n.id not in _FUNCTIONS]
        return tuple(dict.fromkeys(names))

    @cached_property
    def nodes(self) -> int:
        """Operators, functions, columns and numbers that it is written with, shift and scale of an input left out."""
        pending: list[ast.AST] = [self._tree.body]
        count = 0
        while pending:
            node = pending.pop()
            count += 1
            if not _scaled_input(node):
                below = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
                pending += [n for n in below if isinstance(n, ast.expr)]
        return count

    @cached_property
    def operators(self) -> int:
        """How many operators and functions it is written with, besides shift and scale of an input."""
        found = [n for n in ast.walk(self._tree) if isinstance(n, ast.BinOp | ast.UnaryOp | ast.Call)]
        return sum(not _scaled_input(n) for n in found)

    @cached_property
    def call(self) -> tuple[str, str]:
        """Name and argument of the function that it is a call of, `sin` and `2*J4`; both empty where it is none."""
        match self._tree.body:
            case ast.Call(func=ast.Name(id=name), args=[argument]):
                return name, ast.unparse(argument)
        return "", ""

    def __call__(self, states: Columns) -> Array:
        with np.errstate(all="ignore"):
            value = _evaluate(self._tree.body, states)
        return np.broadcast_to(np.asarray(value, dtype=float), (len(states),))

    def __str__(self) -> str:
        return self.text


@lru_cache(maxsize=1 << 16)
def _parsed(text: str) -> ast.Expression:
    """The tree of an expression, checked; thousands of candidates are written anew in every round."""
    try:
        tree = ast.parse(text, mode="eval")
    except SyntaxError:
        raise InputError(f"basis '{text}': not an expression; write for example sin(2*J4)") from None
    for node in ast.walk(tree):
        call_ok = not isinstance(node, ast.Call) or (
            isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS and not node.keywords
        )
        number_ok = not isinstance(node, ast.Constant) or isinstance(node.value, (int, float))
        if not (isinstance(node, _NODES) and call_ok and number_ok):
            raise InputError(
                f"basis '{text}': '{ast.unparse(node)}' is not allowed; expected arithmetic and {', '.join(_FUNCTIONS)}"
            )
    return tree


ONE = Expression("1")


def _scaled_input(node: ast.AST) -> bool:
    """Whether it is an input less a number, over a number, or both."""
    if not isinstance(node, ast.BinOp) or not isinstance(node.right, ast.Constant):
        return False
    if isinstance(node.op, ast.Div) and _scaled_input(node.left):
        return True
    return isinstance(node.op, ast.Div | ast.Sub) and isinstance(node.left, ast.Name)


def _evaluate(node: ast.AST, states: Columns) -> Any:
    match node:
        case ast.Constant(value=value):
            return value
        case ast.Name(id=name):
            return states[name]
        case ast.UnaryOp(op=op, operand=operand):
            inner = _evaluate(operand, states)
            return -inner if isinstance(op, ast.USub) else inner
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name](*(_evaluate(a, states) for a in args))
        case ast.BinOp(left=left, op=op, right=right):
            a, b = _evaluate(left, states), _evaluate(right, states)
            operations = {
                ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply,
                ast.Div: np.divide, ast.Pow: np.float_power, ast.Mod: np.mod,
            }  # fmt: skip
            return operations[type(op)](a, b)
    raise InputError(f"'{ast.dump(node)}' is not allowed in a basis")
