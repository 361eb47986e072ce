"""An evolved expression as an object: a small directed graph of operators over named inputs."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from keyword import iskeyword
from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.formula.operators import BY_NAME

_INFIX = {"add": ("+", 1), "subtract": ("-", 1), "multiply": ("*", 2), "divide": ("/", 2), "modulo": ("%", 2)}
_ATOM = 9


class Named(Protocol):
    """Columns (N,) by name."""

    def __getitem__(self, name: str, /) -> Array: ...


class Node(NamedTuple):
    """A leaf (``input`` with its name, ``constant`` with its value) or an operator over earlier nodes."""

    operator: str
    arguments: tuple[int, ...] = ()
    value: str | float | None = None


@dataclass(frozen=True)
class Program:
    """Effective code only: every node reaches an output, equal nodes are one, arguments precede their use.

    ``evaluate`` gives one row an output; the outputs of a slot's program are a small set of basis functions.
    """

    nodes: tuple[Node, ...]
    outputs: tuple[int, ...]

    def evaluate(self, inputs: Mapping[str, Array]) -> Array:
        """Values of the outputs, shape (outputs, N), from a mapping of input name to (N,) array.

        Raises InputError where an input of the program is missing.
        """
        missing = sorted(set(self.inputs) - set(inputs))
        if missing:
            raise InputError(f"program {self}: no input {missing[0]!r}, available: {choices(missing[0], inputs)}")
        length = max((np.size(column) for column in inputs.values()), default=1)
        values = self.values(inputs, length)
        return np.array([values[k] for k in self.outputs]).reshape(-1, length)

    def values(self, columns: Named, length: int, constants: Iterable[float] | None = None) -> list[Array]:
        """Values (N,) of every node, N being ``length``, by the functions of ``gpmodel.formula.operators``.

        constants: others than its own. A value that is no number comes back as NaN or infinity, without a warning.
        """
        found: list[Array] = []
        remaining = iter(self.constants if constants is None else constants)
        with np.errstate(all="ignore"):
            for node in self.nodes:
                if node.operator == "input":
                    found.append(np.asarray(columns[str(node.value)], dtype=float))
                elif node.operator == "constant":
                    found.append(np.full(length, next(remaining)))
                else:
                    found.append(BY_NAME[node.operator].function(*(found[k] for k in node.arguments)))
        return found

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs that effective code references, sorted."""
        return tuple(sorted(str(node.value) for node in self.nodes if node.operator == "input"))

    @cached_property
    def constants(self) -> tuple[float, ...]:
        """Constants of the effective code, in node order."""
        return tuple(float(node.value or 0.0) for node in self.nodes if node.operator == "constant")

    @cached_property
    def input_counts(self) -> dict[str, int]:
        """Number of references to each input in effective code."""
        counts: dict[str, int] = {}
        for index in self._references():
            if self.nodes[index].operator == "input":
                name = str(self.nodes[index].value)
                counts[name] = counts.get(name, 0) + 1
        return counts

    @cached_property
    def operator_counts(self) -> dict[str, int]:
        """Number of occurrences of each operator in effective code."""
        return dict(Counter(node.operator for node in self.nodes if node.arguments))

    @cached_property
    def complexity(self) -> int:
        """Operators plus references to leaves; a shared subexpression counts once."""
        leaves = sum(1 for index in self._references() if not self.nodes[index].arguments)
        return leaves + sum(1 for node in self.nodes if node.arguments)

    def _references(self) -> Iterable[int]:
        for node in self.nodes:
            yield from node.arguments
        yield from self.outputs

    def select(self, outputs: Iterable[int]) -> "Program":
        """The program of some of the outputs, by position; nodes that reach none of them are left out."""
        return Builder(list(self.nodes)).program(self.outputs[k] for k in outputs)

    def with_constants(self, values: Iterable[float]) -> "Program":
        """Return the program with other constants, in the order of ``constants``; equal ones become one node.

        Raises InputError for one that is not finite.
        """
        remaining = iter(values)
        return self.with_leaves(
            Node("constant", (), next(remaining)) if node.operator == "constant" else node for node in self.nodes
        )

    def with_leaves(self, nodes: Iterable[Node]) -> "Program":
        """The program with other leaves, from all its nodes in turn; equal leaves become one node.

        Raises InputError for a constant that is not finite.
        """
        changed = tuple(nodes)
        leaves = [node for node in changed if not node.arguments]
        for node in leaves:
            if node.operator == "constant" and not isfinite(float(node.value or 0.0)):
                raise InputError(f"program: constant {node.value} is not finite")
        other = Program(changed, self.outputs)
        return other if len(set(leaves)) == len(leaves) else other.rebuilt(Builder.add)

    def with_inputs(self, programs: Mapping[str, "Program"]) -> "Program":
        """Return the program with one-output programs substituted for the inputs of these names."""

        def build(builder: Builder, node: Node, copies: list[int]) -> int:
            other = programs.get(str(node.value)) if node.operator == "input" else None
            return builder.copy(other)[other.outputs[0]] if other else builder.add(node, copies)

        return self.rebuilt(build)

    def rebuilt(self, build: "Build") -> "Program":
        """The program of what is built for each node in turn, beside the numbers of those built before it."""
        builder, copies = Builder(), list[int]()
        for node in self.nodes:
            copies.append(build(builder, node, copies))
        return builder.program(copies[k] for k in self.outputs)

    def __str__(self) -> str:
        """Infix text that ``parse`` reads back; shared subexpressions are named first, outputs follow ``;``."""
        return self._text(named=True)

    def written_out(self) -> str:
        """Write the program without names: a shared subexpression is repeated at each use."""
        return self._text(named=False)

    def _text(self, named: bool) -> str:
        uses = np.zeros(len(self.nodes), dtype=int)
        for index in self._references():
            uses[index] += 1
        texts: list[tuple[str, int]] = []
        lines: list[str] = []
        taken = set(self.inputs)
        for index, node in enumerate(self.nodes):
            text, rank = _node_text(node, texts)
            if named and node.arguments and uses[index] > 1:
                name = next(f"v{k}" for k in range(len(lines) + 1, 10**9) if f"v{k}" not in taken)
                taken.add(name)
                lines.append(f"{name} = {text}")
                text, rank = name, _ATOM
            texts.append((text, rank))
        lines.append(", ".join(texts[k][0] for k in self.outputs))
        return "; ".join(lines)


def _node_text(node: Node, texts: list[tuple[str, int]]) -> tuple[str, int]:
    if node.operator == "input":
        name = str(node.value)
        return (name if name.isidentifier() and not iskeyword(name) else repr(name)), _ATOM
    if node.operator == "constant":
        value = float(node.value or 0.0)
        text = repr(int(value)) if value == int(value) and abs(value) < 1e6 else repr(value)
        return (text, _ATOM) if value >= 0 else (f"({text})", _ATOM)
    if node.operator in _INFIX:
        symbol, rank = _INFIX[node.operator]
        (left, left_rank), (right, right_rank) = (texts[k] for k in node.arguments)
        left = f"({left})" if left_rank < rank else left
        right = f"({right})" if right_rank <= rank else right
        return f"{left} {symbol} {right}" if rank == 1 else f"{left}{symbol}{right}", rank
    if node.operator == "not":
        return f"(not {texts[node.arguments[0]][0]})", _ATOM
    return f"{node.operator}({', '.join(texts[k][0] for k in node.arguments)})", _ATOM


@dataclass
class Builder:
    """Collects nodes, merging equal ones, and hands out a program without dead code."""

    nodes: list[Node] = field(default_factory=list)
    _known: dict[Node, int] = field(default_factory=dict)

    def _intern(self, node: Node) -> int:
        if node not in self._known:
            self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return self._known[node]

    def input(self, name: str) -> int:
        """The number of the node that reads a column."""
        return self._intern(Node("input", (), name))

    def constant(self, value: float) -> int:
        """The number of the node that is a constant. Raises InputError where it is not finite."""
        if not isfinite(value):
            raise InputError(f"program: constant {value} is not finite")
        return self._intern(Node("constant", (), float(value)))

    def apply(self, operator: str, *arguments: int) -> int:
        """The number of the node that applies an operator to earlier ones. Raises InputError for an unknown one."""
        if operator not in BY_NAME:
            raise InputError(f"program: unknown operator {operator!r}, available: {choices(operator, BY_NAME)}")
        if len(arguments) != BY_NAME[operator].arity:
            raise InputError(f"program: {operator} takes {BY_NAME[operator].arity} arguments, {len(arguments)} given")
        return self._intern(Node(operator, arguments))

    def add(self, node: Node, copies: list[int]) -> int:
        """A node of another program, its arguments translated by ``copies``."""
        return self._intern(Node(node.operator, tuple(copies[k] for k in node.arguments), node.value))

    def copy(self, program: Program) -> list[int]:
        """All nodes of a program; the new index of each."""
        copies: list[int] = []
        for node in program.nodes:
            copies.append(self.add(node, copies))
        return copies

    def program(self, outputs: Iterable[int]) -> Program:
        """The program of some nodes; its own nodes are in the order in which the outputs first need them."""
        chosen = tuple(outputs)
        place: dict[int, int] = {}
        pending = list(reversed(chosen))
        while pending:
            index = pending[-1]
            missing = [k for k in reversed(self.nodes[index].arguments) if k not in place]
            if index in place or not missing:
                place.setdefault(index, len(place))
                pending.pop()
            pending.extend(missing if index not in place else ())
        nodes = tuple(
            Node(node.operator, tuple(place[k] for k in node.arguments), node.value)
            for node in (self.nodes[index] for index in place)
        )
        return Program(nodes, tuple(place[k] for k in chosen))


Build = Callable[[Builder, Node, list[int]], int]
"""Builds the node that stands for another in a copy of its program, and says its number."""


LINEAR = ("add", "subtract", "multiply", "divide")
CURVED = frozenset(("sin", "cos", "tan", "atan", "exp", "log", "tanh", "asin", "reciprocal", "logistic"))
NESTED = 2
"""Additional price of a function inside a function, nodes. With it two of 40 drawn formulas of two inputs became better
and none worse."""


def description_size(program: Program) -> int:
    """Nodes of a program, and `NESTED` more for every curved function of a curved function."""
    curved, nested = list[bool](), 0
    for node in program.nodes:
        inside = any(curved[k] for k in node.arguments)
        nested += inside and node.operator in CURVED
        curved.append(inside or node.operator in CURVED)
    return program.complexity + NESTED * nested


def length(program: Program) -> int:
    """Operators, inputs and constants of a program written out; an input with an origin and a scale counts as one."""
    nodes, sizes, plain = program.nodes, list[int](), list[bool]()
    for node in nodes:
        plain.append(node.operator == "input" or _scales(node, nodes, plain))
        sizes.append(1 if plain[-1] else 1 + sum(sizes[k] for k in node.arguments))
    return sum(sizes[k] for k in program.outputs)


def _scales(node: Node, nodes: tuple[Node, ...], plain: list[bool]) -> bool:
    """Return whether a node shifts or scales an input by a constant; plain: whether each earlier node does no more."""
    if node.operator not in LINEAR:
        return False
    first, second = node.arguments
    by_constant = nodes[second].operator == "constant" and plain[first]
    return by_constant or (nodes[first].operator == "constant" and plain[second] and node.operator != "divide")
