"""Convert evolved programs to candidate effects at a site: functions of table columns without poles between poses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np

from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import law_name, numbered
from gpmodel.formula.expression import Columns, Expression
from gpmodel.formula.program import Builder, Node, Program
from gpmodel.model.effect import axis_unit
from gpmodel.model.sites import Site
from gpmodel.model.states import States

DIGITS = 5
"""Significant digits of a constant in an evolved formula. The formula's coefficient is fitted afterwards."""


def as_candidate(program: Program, site: Site, names: Mapping[str, str], cost: float, maker: str) -> Candidate | None:
    """Return a program as effects at a site, one effect for each output; None if the program depends on no input."""
    texts = [expression_text(program.select([k]), names) for k in range(len(program.outputs))]
    try:
        bases = [Expression(t) for t in dict.fromkeys(texts)]
    except InputError:
        return None
    bases = [b for b in bases if b.inputs]
    if not bases:
        return None
    effects = [site.effect("", basis, axis_unit(site.axis)) for basis in bases]
    return Candidate(law_name(effects), numbered(effects), "", cost, maker)


def parts(program: Program) -> list[Program]:
    """Return programs of all proper subsets of an evolved program's outputs; empty for a program of one output."""
    count = len(program.outputs)
    fewer = {size: list(combinations(range(count), size)) for size in range(1, count)}
    return [program.select(chosen) for chosen in chain(*fewer.values())]


def laws(candidate: Candidate, cost: Callable[[int], float]) -> tuple[Candidate, ...]:
    """Split an evolved candidate into one formula for each set of inputs that its terms share.

    cost: function from the number of nodes of a formula to its penalty, nats.
    """
    sets: list[list[int]] = []
    for k, effect in enumerate(candidate.effects):
        shared = [own for own in sets if any(set(candidate.effects[i].inputs) & set(effect.inputs) for i in own)]
        sets = [own for own in sets if own not in shared] + [sorted([*chain(*shared), k])]
    if candidate.family or len(sets) == 1:
        return (candidate,)
    return tuple(_some(candidate, own, cost) for own in sets)


def terms(candidate: Candidate, cost: Callable[[int], float]) -> tuple[Candidate, ...]:
    """Return each term of an unnamed evolved candidate as a candidate. cost: penalty, nats, by number of nodes."""
    if candidate.family or len(candidate.effects) == 1:
        return ()
    return tuple(_some(candidate, [k], cost) for k in range(len(candidate.effects)))


def _some(candidate: Candidate, own: Sequence[int], cost: Callable[[int], float]) -> Candidate:
    """Return a candidate with some of another candidate's effects, at positions `own`. cost: penalty by nodes, nats."""
    effects = [candidate.effects[k] for k in own]
    nodes = sum(Expression(str(effect.terms[0].basis)).program.complexity for effect in effects)
    return replace(candidate, name=law_name(effects), effects=numbered(effects), cost=cost(nodes))


def without_poles(criteria: Criteria, candidate: Candidate, measured: States, between: Columns) -> bool:
    """Return whether a candidate's basis functions remain bounded, without a pole, between the measured poses."""
    for effect in candidate.effects:
        for term in effect.terms:
            largest = float(np.max(np.abs(term.basis(between))))
            if not largest <= criteria.largest_between * float(np.max(np.abs(term.basis(measured)))):
                return False
    return True


def expression_text(program: Program, names: Mapping[str, str]) -> str:
    """Write a one-output program as text in the table's columns, with constants of `DIGITS` digits.

    A program that is a single input is written unscaled, because its coefficient includes the scale.
    """
    if len(program.nodes) == 1 and program.nodes[0].operator == "input":
        return str(program)
    rounded = program.with_constants(float(f"{value:.{DIGITS}g}") for value in program.constants)
    written = {name: Expression(names[name]).program for name in rounded.inputs}
    return with_plain_signs(rounded.with_inputs(written)).written_out()


_OTHER = {"add": "subtract", "subtract": "add"}


def with_plain_signs(program: Program) -> Program:
    """Return an equal program with x - (-c) as x + c and -c + x as x - c, for constants c and products c·y."""
    return program.rebuilt(_plain)


def _plain(builder: Builder, node: Node, copies: list[int]) -> int:
    """Write a sum or difference of a formula so that its second operand does not begin with a negative number."""
    if node.operator not in _OTHER:
        return builder.add(node, copies)
    first, second = (copies[k] for k in node.arguments)
    if node.operator == "add" and _turned(builder, second) is None:
        first, second = (second, first) if _turned(builder, first) is not None else (first, second)
    turned = _turned(builder, second)
    return (
        builder.apply(node.operator, first, second)
        if turned is None
        else builder.apply(_OTHER[node.operator], first, turned)
    )


def _turned(builder: Builder, index: int) -> int | None:
    """Negate a node that is a negative number or a product with a negative first factor; None for other nodes."""
    node = builder.nodes[index]
    if node.operator == "multiply":
        factor = _turned(builder, node.arguments[0]) if _is_number(builder, node.arguments[0]) else None
        return None if factor is None else builder.apply("multiply", factor, node.arguments[1])
    value = float(node.value or 0.0) if _is_number(builder, index) else 0.0
    return builder.constant(-value) if value < 0 else None


def _is_number(builder: Builder, index: int) -> bool:
    return builder.nodes[index].operator == "constant"
