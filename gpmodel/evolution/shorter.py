"""Shorter forms of an evolved program: one node less, or a constant at a value that needs no node.

Constants that need no node are 0, 1 or -1 in a sum or product, ±π/2 in a sine, an exponent of 2, and a constant equal
to another constant, whose terms can be merged:
    x + 0 = x,  1 x = x,  y + (-1) x = y - x,  sin(x + π/2) = cos(x),  |x|^2 = x²
The constants need not be near the listed values: each shorter form is fitted again and selected by its description
length.
"""

from collections.abc import Iterator, Mapping, Sequence
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
            shorter = _replaced(program, {index: ("", [argument])})
            if shorter.inputs:
                yield shorter
                if node.operator in MINUS:
                    yield from _with_other_wave(program, index, argument)
        yield from _without_constant(program, index, node)
    values = program.constants
    for one, other in permutations(range(len(values)), 2):
        tied = program.with_constants([*values[:other], values[one], *values[other + 1 :]])
        if tied.complexity < program.complexity:
            yield tied


def _replaced(program: Program, made: Mapping[int, tuple[str, Sequence[int]]]) -> Program:
    """Return the program in which some nodes are replaced, by number, by an operator ("": none) of earlier nodes."""

    def build(builder: Builder, node: Node, copies: list[int]) -> int:
        operator, arguments = made.get(len(copies), (node.operator, ()))
        if not arguments:
            return builder.add(node, copies)
        return builder.apply(operator, *(copies[k] for k in arguments)) if operator else copies[arguments[0]]

    return program.rebuilt(build)


def _with_other_wave(program: Program, index: int, argument: int) -> Iterator[Program]:
    """Yield the program with sin(term + constant) replaced by cos(term), or with a cosine replaced by a sine."""
    (other,) = set(program.nodes[index].arguments) - {argument} or {argument}
    if program.nodes[other].operator != "constant":
        return
    inside = {index}
    for wave in range(index + 1, len(program.nodes)):
        node = program.nodes[wave]
        if node.operator in OTHER_WAVE and inside.intersection(node.arguments):
            yield _replaced(program, {index: ("", [argument]), wave: (OTHER_WAVE[node.operator], node.arguments)})
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
                    yield _replaced(program, {index: (MINUS[node.operator], (other, scaled))})
        elif node.operator == "power" and inner.operator == "abs":
            yield _replaced(program, {index: ("square", inner.arguments)})
