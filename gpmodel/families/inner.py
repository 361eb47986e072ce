"""An inner constant of a candidate, a frequency or a time constant: one candidate a value."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from gpmodel.families.candidate import Candidate, Inner
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect
from gpmodel.model.memory import word

CONSTANT = "CONSTANT"
"""Stands for the inner constant in the names and bases of a template."""


def on_grid(template: Candidate, values: Sequence[float]) -> Iterator[Candidate]:
    """The template at every value of a grid."""
    for value in values:
        yield at(replace(template, inner=Inner(template.name, template.effects, value)), value)


def at(candidate: Candidate, value: float) -> Candidate:
    """The same candidate with another value of its inner constant; itself where it has none."""
    inner = candidate.inner
    if inner is None:
        return candidate
    effects = tuple(_filled(e, value) for e in inner.template)
    return replace(candidate, name=_put(inner.name, value), effects=effects, inner=replace(inner, value=value))


def geometric(lowest: float, highest: float, count: int) -> list[float]:
    """`count` values in constant ratio, to three digits."""
    return [float(f"{v:.3g}") for v in np.geomspace(lowest, highest, count)]


def _put(text: str, value: float) -> str:
    return text.replace(f"_{CONSTANT}", f"_{word(value)}").replace(CONSTANT, f"{value:.5g}")


def _filled(effect: Effect, value: float) -> Effect:
    terms = tuple(replace(t, basis=Expression(_put(str(t.basis), value))) for t in effect.terms)
    return replace(effect, name=_put(effect.name, value), terms=terms)
