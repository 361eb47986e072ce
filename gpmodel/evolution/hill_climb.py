"""Single edits of a slot's program, all tried at once: what evolution nearly found is finished by climbing."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.building_blocks import Pieces, Rows, Vocabulary
from gpmodel.evolution.problems import Inputs
from gpmodel.formula.operators import BY_NAME, Operator
from gpmodel.formula.program import Builder, Program

Kinds = NDArray[np.uint8]

MOST_STEPS = 8
CHECKED = 8
"""Edits one after the other at most; trials of each that are scored exactly."""


class Hill(Protocol):
    """Interface of a problem for hill climbing."""

    @property
    def inputs(self) -> Inputs:
        """The columns that a program may read."""

    def nats(self, gain: Array | float, size: Array | float) -> Array:
        """Description length saved by a gain at the price of nodes and coefficients."""

    def set_gain(self, values: Array, site: int) -> float:
        """Gain of a program's outputs (m, N) at a site."""

    def set_gains(self, values: Sequence[Array], site: int) -> Array:
        """Gains (P,) of many programs at a site, about as ``set_gain`` does.

        values: (P, N) of each of their outputs, (1, N) of one that all of them share.
        """


def climbed(program: Program, problem: Hill, site: int, words: Vocabulary, most_outputs: int = 3) -> Program:
    """The program at the top of the hill of single edits, by description length at one site; never a worse one.

    Edits of a node: another element, operator or earlier node in its place, an operator or an element joined to it; and
    one element more as an output, up to ``most_outputs``. Each step takes the best edit of all.
    """
    columns = problem.inputs.mapping()

    def saved(one: Program) -> float:
        gain = problem.set_gain(one.evaluate(columns), site)
        return float(problem.nats(gain, one.complexity + len(one.outputs)))

    best = saved(program)
    for _ in range(MOST_STEPS):
        trials = sorted(_trials(program, problem, site, words, most_outputs), key=lambda trial: -trial[0])[:CHECKED]
        edited = [(saved(one), one) for one in (build() for _, build in trials)]
        nats, top = max(edited, key=itemgetter(0), default=(best, program))
        if not nats > best + 1e-6:
            break
        best, program = nats, top
    return program


def _trials(
    program: Program, problem: Hill, site: int, words: Vocabulary, most_outputs: int
) -> Iterator[tuple[float, Callable[[], Program]]]:
    """The most promising edits of every node, with about the description length that they save."""
    with np.errstate(all="ignore"):
        whole = Program(program.nodes, tuple(range(len(program.nodes))))
        values = list(whole.evaluate(problem.inputs.mapping()))
        size = program.complexity + len(program.outputs)
        kinds = words.typing.of_nodes(program, words.inputs.names)
        for node in range(len(program.nodes) + (len(program.outputs) < most_outputs)):
            edits = _edits(program, node, values, kinds, words)
            numbers = range(len(words.typing.kinds))
            edits = edits.of_kinds([k for k in numbers if words.typing.allows(program, words.inputs.names, {node: k})])
            if not len(edits.growth):
                continue
            gains = problem.set_gains(_outputs_after(program, node, values, edits.values), site)
            about = problem.nats(gains, size + edits.growth)
            for k in np.argsort(-about, kind="stable")[:CHECKED].tolist():
                yield float(about[k]), partial(_rebuilt, program, node, edits, k)


def _edits(program: Program, node: int, values: list[Array], kinds: list[int], words: Vocabulary) -> Pieces:
    """Return the replacements of a node; past the last node, the possible additional outputs."""
    known, earlier = np.array(kinds, dtype=np.uint8), range(min(node + 1, len(program.nodes)))
    repeated = (_repeated(k, values[k], known[k : k + 1], words) for k in earlier)
    chained = Pieces.chained([words.elements, *repeated])
    elements = replace(chained, at=chained.values.__getitem__)
    if node == len(program.nodes):
        return replace(elements, growth=elements.growth + 1.0)
    here, value, of_kind = program.nodes[node], values[node], words.typing.of

    def joined(operator: Operator) -> Pieces:
        def build(builder: Builder, copies: list[int], k: int) -> int:
            return builder.apply(operator.name, copies[node], elements.build(builder, copies, k))

        made = of_kind(operator, known[node : node + 1], elements.kinds)
        return Pieces(elements.growth + 1.0, made, lambda rows: operator.function(value, elements.at(rows)), build)

    def wrapped(operator: Operator) -> Pieces:
        def build(builder: Builder, copies: list[int], k: int) -> int:
            twice = builder.apply("multiply", builder.constant(2.0), copies[node]) if k else copies[node]
            return builder.apply(operator.name, twice)

        made = of_kind(operator, np.repeat(known[node], 2))
        turns = np.array([[1.0], [2.0]])
        return Pieces(np.array([1.0, 3.0]), made, lambda rows: operator.function(turns[rows] * value), build)

    def swapped(operator: Operator) -> Pieces:
        def build(builder: Builder, copies: list[int], k: int) -> int:
            return builder.apply(operator.name, *(copies[argument] for argument in here.arguments))

        made = of_kind(operator, *(known[k : k + 1] for k in here.arguments))
        return Pieces(np.zeros(1), made, lambda _: operator.function(*(values[k] for k in here.arguments))[None], build)

    parts = [replace(elements, growth=elements.growth - _written_out(program, node))]
    parts += [joined(operator) for operator in words.binary]
    parts += [wrapped(operator) for operator in words.unary]
    parts += [swapped(o) for o in words.operators if o.arity == len(here.arguments)]
    return Pieces.chained(parts)


def _repeated(node: int, value: Array, kind: Kinds, words: Vocabulary) -> Pieces:
    """A node that the program has, and one-argument operators of it: shared, so that only the operator adds to it."""

    unary = words.unary

    def build(builder: Builder, copies: list[int], k: int) -> int:
        return builder.apply(unary[k - 1].name, copies[node]) if k else copies[node]

    kinds = np.concatenate([kind, *(words.typing.of(operator, kind) for operator in unary)])

    def at(rows: Rows) -> Array:
        return np.stack([unary[k - 1].function(value) if k else value for k in rows.tolist()])

    return Pieces(np.array([0.0] + [1.0] * len(unary)), kinds, at, build)


def _written_out(program: Program, node: int) -> float:
    """Nodes below and including one, shared ones as often as they are used."""
    sizes: list[float] = []
    for earlier in program.nodes[: node + 1]:
        sizes.append(1.0 + sum(sizes[k] for k in earlier.arguments))
    return sizes[node]


def _outputs_after(program: Program, node: int, values: list[Array], rows: Array) -> list[Array]:
    """Outputs of the program, with each of the rows (E, N) in the place of a node or as an output more: (E, N) of one
    that depends on it, (1, N) of the others."""
    changed: dict[int, Array] = {node: rows}
    for later in range(node + 1, len(program.nodes)):
        arguments = program.nodes[later].arguments
        if any(k in changed for k in arguments):
            function = BY_NAME[program.nodes[later].operator].function
            changed[later] = function(*(changed.get(k, values[k]) for k in arguments))
    outputs = [changed[k] if k in changed else values[k][None] for k in program.outputs]
    return [*outputs, rows] if node == len(program.nodes) else outputs


def _rebuilt(program: Program, node: int, edits: Pieces, k: int) -> Program:
    """The program with one edit made."""
    builder = Builder()
    copies: list[int] = []
    for index, old in enumerate(program.nodes):
        copies.append(builder.add(old, copies))
        if index == node:
            copies[index] = edits.build(builder, copies, k)
    outputs = [copies[index] for index in program.outputs]
    if node == len(program.nodes):
        outputs.append(edits.build(builder, copies, k))
    return builder.program(outputs)
