"""An inner constant of a candidate, a frequency or a time constant: on a grid first, then refined."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from gpmodel.families.candidate import Candidate, Inner
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect
from gpmodel.model.memory import word

CONSTANT = "CONSTANT"
"""Stands for the inner constant in the names and bases of a template."""

EVALUATIONS = 24
"""Enough for golden section to shrink an interval by 1e4; parabolic steps do with fewer."""


def on_grid(template: Candidate, values: Sequence[float]) -> Iterator[Candidate]:
    """The template at every value of an increasing grid, each refinable as far as its neighbours."""
    edges = [values[0], *values, values[-1]]
    for k, value in enumerate(values, 1):
        inner = Inner(template.name, template.effects, value, edges[k - 1], edges[k + 1])
        yield at(replace(template, inner=inner), value)


def at(candidate: Candidate, value: float) -> Candidate:
    """The same candidate with another value of its inner constant; itself where it has none."""
    inner = candidate.inner
    if inner is None:
        return candidate
    effects = tuple(_filled(e, value) for e in inner.template)
    return replace(candidate, name=_put(inner.name, value), effects=effects, inner=replace(inner, value=value))


def refined(candidate: Candidate, worth: Callable[[Candidate], float]) -> Candidate:
    """The candidate with the inner constant that is worth most between its neighbours on the grid.

    worth: nats of a candidate. Its cost has paid for the grid, one independent value a point: refining adds none.
    """
    inner = candidate.inner
    if inner is None or inner.upper <= inner.lower:
        return candidate
    found = minimize_scalar(
        lambda value: -worth(at(candidate, float(value))), bounds=(inner.lower, inner.upper), method="bounded",
        options={"maxiter": EVALUATIONS, "xatol": 1e-4 * inner.value},
    )  # fmt: skip
    better = at(candidate, float(f"{found.x:.4g}"))
    return better if worth(better) > worth(candidate) else candidate


def geometric(lowest: float, highest: float, count: int) -> list[float]:
    """`count` values in constant ratio, to three digits."""
    return [float(f"{v:.3g}") for v in np.geomspace(lowest, highest, count)]


def _put(text: str, value: float) -> str:
    return text.replace(f"_{CONSTANT}", f"_{word(value)}").replace(CONSTANT, f"{value:.5g}")


def _filled(effect: Effect, value: float) -> Effect:
    terms = tuple(replace(t, basis=Expression(_put(str(t.basis), value))) for t in effect.terms)
    return replace(effect, name=_put(effect.name, value), terms=terms)
