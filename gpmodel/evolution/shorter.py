"""Shorter forms of an evolved program: one node less, or a constant at a value that needs no node.

Constants that need no node are 0, 1 or -1 in a sum or product, ±π/2 in a sine, ±1 added to tanh, an exponent of 2, and
a constant equal to another constant, whose terms can be merged:
    x + 0 = x,  1 x = x,  y + (-1) x = y - x,  sin(x + π/2) = cos(x),  1 + tanh(x) = 2 logistic(2 x),  |x|^2 = x²
The constants need not be near the listed values: each shorter form is fitted again and selected by its description
length.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import permutations

from gpmodel.formula.program import Builder, Node, Program

LINEAR = ("add", "subtract", "multiply")
OTHER_WAVE = {"sin": "cos", "cos": "sin"}
MINUS = {"add": "subtract", "subtract": "add"}


def shorter_forms(program: Program) -> Iterator[Program]:
    """Yield programs with fewer nodes that still depend on an input. Every node is replaced by each of its arguments,
    every constant takes values that make its node superfluous, and constants are set equal."""
    for index, node in enumerate(program.nodes):
        for argument in node.arguments:
            shorter = replaced(program, {index: partial(_argument, argument)})
            if shorter.inputs:
                yield shorter
                if node.operator in ("add", "subtract"):
                    yield from _with_other_wave(program, index, argument)
        yield from _without_constant(program, index, node)
    values = program.constants
    for one, other in permutations(range(len(values)), 2):
        tied = program.with_constants([*values[:other], values[one], *values[other + 1 :]])
        if tied.complexity < program.complexity:
            yield tied


Made = Callable[[Builder, list[int]], int]
"""Function that adds nodes to a builder, given the new indices of the earlier nodes, and returns the index of the last
added node."""


def replaced(program: Program, made: Mapping[int, Made]) -> Program:
    """Return the program in which some nodes are replaced. made: function that adds the replacement, by index of the
    node."""

    def build(builder: Builder, node: Node, copies: list[int]) -> int:
        make = made.get(len(copies))
        return make(builder, copies) if make else builder.add(node, copies)

    return program.rebuilt(build)


def _argument(argument: int, builder: Builder, copies: list[int]) -> int:
    return copies[argument]


def _applied(operator: str, arguments: tuple[int, ...], builder: Builder, copies: list[int]) -> int:
    return builder.apply(operator, *(copies[k] for k in arguments))


def _with_other_wave(program: Program, index: int, argument: int) -> Iterator[Program]:
    """Yield the program with sin(term + constant) replaced by cos(term), or with a cosine replaced by a sine."""
    (other,) = set(program.nodes[index].arguments) - {argument} or {argument}
    if program.nodes[other].operator != "constant":
        return
    inside = {index}
    for wave in range(index + 1, len(program.nodes)):
        node = program.nodes[wave]
        if node.operator in OTHER_WAVE and inside.intersection(node.arguments):
            other_wave = partial(_applied, OTHER_WAVE[node.operator], node.arguments)
            yield replaced(program, {index: partial(_argument, argument), wave: other_wave})
        if node.operator in LINEAR and inside.intersection(node.arguments):
            inside.add(wave)


def _without_constant(program: Program, index: int, node: Node) -> Iterator[Program]:
    """Yield the program without the constant of a sum, difference or power."""
    nodes = program.nodes
    for place, argument in enumerate(node.arguments):
        inner, other = nodes[argument], node.arguments[-1 - place]
        if node.operator in MINUS and inner.operator == "multiply":
            for factor, scaled in (inner.arguments, inner.arguments[::-1]):
                if nodes[factor].operator == "constant" and float(nodes[factor].value or 0.0) < 0.0:
                    yield replaced(program, {index: partial(_applied, MINUS[node.operator], (other, scaled))})
        elif node.operator in MINUS and inner.operator == "tanh" and nodes[other].operator == "constant":
            above = float(nodes[other].value or 0.0) * (1.0 if node.operator == "add" else -1.0)
            yield from _logistic(program, index, nodes[inner.arguments[0]], above < 0.0)
        elif node.operator == "power" and inner.operator == "abs":
            yield replaced(program, {index: partial(_applied, "square", inner.arguments)})


def _logistic(program: Program, index: int, inside: Node, falls: bool) -> Iterator[Program]:
    """Yield the program with tanh(k x) and a constant replaced by logistic(±2 k x). inside: node of the term k x."""
    for factor, scaled in (inside.arguments, inside.arguments[::-1]) if inside.operator == "multiply" else ():
        scale = program.nodes[factor]
        if scale.operator == "constant":
            twice = (-2.0 if falls else 2.0) * float(scale.value or 0.0)
            yield replaced(program, {index: partial(scaled_in, "logistic", twice, scaled)})


def scaled_in(operator: str, scale: float, inner: int, builder: Builder, copies: list[int]) -> int:
    """Add to a builder an operator applied to a node times a number."""
    return builder.apply(operator, builder.apply("multiply", builder.constant(scale), copies[inner]))
