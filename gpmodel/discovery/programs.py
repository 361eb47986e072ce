"""Evolved programs as candidates: effects at a site, written over the table's columns, without poles between poses."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import chain, combinations

import numpy as np

from gpmodel.discovery.criteria import Criteria
from gpmodel.errors import InputError
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Columns, Expression
from gpmodel.formula.program import Program
from gpmodel.model.effect import axis_unit
from gpmodel.model.sites import Site
from gpmodel.model.states import States

DIGITS = 5
"""Of an evolved constant: what stands in front of the basis is fitted anew, with σ, to all of its digits."""


def as_candidate(program: Program, site: Site, names: Mapping[str, str], cost: float) -> Candidate | None:
    """A program as effects at its site, one an output; None where it is no function of any input."""
    texts = [expression_text(program.select([k]), names) for k in range(len(program.outputs))]
    texts = [t for t in dict.fromkeys(texts)]
    try:
        bases = [Expression(t) for t in texts]
    except InputError:
        return None
    bases = [b for b in bases if b.inputs]
    if not bases:
        return None
    label = " and ".join(b.text for b in bases)
    name = f"{label} on {site.name}"
    unit = axis_unit(site.axis)
    effects = tuple(site.effect(f"{name} [{k}]" if len(bases) > 1 else name, b, unit) for k, b in enumerate(bases, 1))
    return Candidate(name, effects, "", cost, "evolved")


def parts(program: Program) -> list[Program]:
    """Each of a program's outputs alone, and all but one of three; none of a program of one."""
    count = len(program.outputs)
    fewer = {size: list(combinations(range(count), size)) for size in range(1, count)}
    return [program.select(chosen) for chosen in chain(*fewer.values())]


def terms(candidate: Candidate, cost: Callable[[int], float]) -> tuple[Candidate, ...]:
    """Each term by itself of what was evolved in several and has no name; none of one. cost: nats of so many nodes."""
    label, _, place = candidate.name.rpartition(" on ")
    bases = label.split(" and ")
    if candidate.family or len(candidate.effects) == 1:
        return ()
    return tuple(
        replace(
            candidate, name=f"{basis} on {place}", effects=(replace(effect, name=f"{basis} on {place}"),),
            cost=cost(Expression(basis).program.complexity),
        )
        for basis, effect in zip(bases, candidate.effects, strict=True)
    )  # fmt: skip


def without_poles(criteria: Criteria, candidate: Candidate, measured: States, between: Columns) -> bool:
    """Whether its bases stay of one size between the measured poses; a quotient that passes a pole there does not."""
    for effect in candidate.effects:
        for term in effect.terms:
            largest = float(np.max(np.abs(term.basis(between))))
            if not largest <= criteria.largest_between * float(np.max(np.abs(term.basis(measured)))):
                return False
    return True


def expression_text(program: Program, names: Mapping[str, str]) -> str:
    """A one-output program as one line of arithmetic over the table's columns, its constants to `DIGITS` digits.

    A program that is a bare input is that input unscaled: its coefficient takes the scale up.
    """
    if len(program.nodes) == 1 and program.nodes[0].operator == "input":
        return str(program)
    rounded = program.with_constants(float(f"{value:.{DIGITS}g}") for value in program.constants)
    written = {name: Expression(names[name]).program for name in rounded.inputs}
    return rounded.with_inputs(written).written_out()
