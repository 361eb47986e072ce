"""Nonlinear constants of a law as unknowns of the last fit, linearised: a change of one is a column like any other."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import family
from gpmodel.families.inner import DIGITS, Constant, law_name, numbered
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, Term
from gpmodel.model.states import States

STEP = 1e-3
"""Step of the central difference, relative to the constant."""

OWN = 0.05
"""Least unique share of a change's column beside the law's own columns: a scale is the coefficient again."""

MOST = 0.3
"""Prior sd: a constant may change its law by 30 % RMS; beyond that the linearisation does not hold."""

HARMONICS = 12
"""Whole numbers up to this are how often per turn, not constants that were fitted."""


@dataclass(frozen=True)
class InnerChange:
    """A constant of a law, and the effect of a unit change of it."""

    constant: Constant
    effect: Effect


@dataclass(frozen=True)
class _Moved:
    """A constant and the bases (E, terms) of a candidate's effects where it is smaller and larger by half a step."""

    constant: Constant
    below: tuple[tuple[str, ...], ...]
    above: tuple[tuple[str, ...], ...]

    @property
    def step(self) -> float:
        """Between the two."""
        return STEP * abs(self.constant.value)


def inner_changes(candidate: Candidate, theta: Sequence[float], states: States) -> tuple[InnerChange, ...]:
    """The change of each constant inside a law, as an effect whose unknown is that change: θ ∂φ/∂c.

    With them in the model the deviations of the law's coefficient and of what it predicts are those of a nonlinear
    least-squares fit, and each constant has one of its own. Constants that the coefficient or the geometry can stand
    for have none. theta: fitted values of its effects. Source: Seber and Wild (1989), 2.1.
    """
    law = _shape(candidate.effects, theta, states)
    taken = [np.ones(len(states)), *(_shape([e], [1.0], states) for e in candidate.effects)]
    out: list[InnerChange] = []
    for moved in _moved(candidate):
        effect = _change(candidate, theta, moved)
        column = _shape([effect], [1.0], states)
        size = float(np.sqrt(np.mean(column**2)))
        own = np.column_stack(taken)
        left = column - own @ np.linalg.lstsq(own, column, rcond=None)[0]
        if not np.isfinite(size) or float(np.sqrt(np.mean(left**2))) <= OWN * size:
            continue
        taken.append(column)
        prior = MOST * float(np.sqrt(np.mean(law**2))) / size
        out.append(InnerChange(moved.constant, replace(effect, prior=prior)))
    return tuple(out)


def moved(candidate: Candidate, values: Mapping[Constant, float]) -> Candidate:
    """A candidate with other values of some constants inside it, called after them where nobody has named it.

    Constants of a template, a lag, a width, a rate, go at most half their way to zero: they have no other sign."""
    if not values:
        return candidate
    inner = candidate.inner
    if inner is not None and set(values) <= set(inner.constants):
        return candidate.at(inner.at([_rounded(_same_sign(values.get(c, c.value), c)) for c in inner.constants]))
    texts = _with(_texts(candidate.effects), {c.value: _rounded(v) for c, v in values.items()})
    effects = tuple(
        replace(e, terms=tuple(replace(t, basis=Expression(text)) for t, text in zip(e.terms, own, strict=True)))
        for e, own in zip(candidate.effects, texts, strict=True)
    )
    if candidate.name != law_name(candidate.effects):
        return replace(candidate, effects=effects)
    return replace(candidate, name=law_name(effects), effects=numbered(effects))


def _same_sign(value: float, constant: Constant) -> float:
    """A value of a constant that is no less than half of what it was."""
    sign = math.copysign(1.0, constant.value)
    return sign * max(sign * value, 0.5 * sign * constant.value)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _moved(candidate: Candidate) -> Iterator[_Moved]:
    """Each distinct constant of the candidate's bases; one that several of them share moves in all of them."""
    inner = candidate.inner
    if candidate.has_priors:
        return
    if inner is not None and any(c.step > 0 for c in inner.constants):
        for k, constant in enumerate(inner.constants):
            if not constant.whole:
                below, above = (_texts(inner.at(_put(inner.values, k, v)).effects) for v in _beside(constant.value))
                yield _Moved(constant, below, above)
    known = family(candidate.family)
    if candidate.family and not (known and known.refit_constants):
        return
    texts = _texts(candidate.effects)
    programs = [Expression(text).program for own in texts for text in own]
    for value in dict.fromkeys(c for program in programs for c in program.constants):
        if value != round(value) or abs(value) > HARMONICS:
            below, above = (_with(texts, {value: v}) for v in _beside(value))
            yield _Moved(Constant("", "1", value), below, above)


def _beside(value: float) -> tuple[float, float]:
    """Half a step to either side of a constant."""
    step = STEP * abs(value)
    return value - step / 2, value + step / 2


def _put(values: Sequence[float], k: int, value: float) -> list[float]:
    return [value if i == k else v for i, v in enumerate(values)]


def _with(texts: tuple[tuple[str, ...], ...], new: Mapping[float, float]) -> tuple[tuple[str, ...], ...]:
    """Bases with constants replaced wherever they are."""
    programs = [[Expression(text).program for text in own] for own in texts]
    return tuple(
        tuple(p.with_constants([new.get(c, c) for c in p.constants]).written_out() for p in own) for own in programs
    )


def _texts(effects: Sequence[Effect]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(str(term.basis) for term in effect.terms) for effect in effects)


def _change(candidate: Candidate, theta: Sequence[float], moved: _Moved) -> Effect:
    """θ (φ above - φ below) / step at the law's own places, all its effects together."""
    terms = []
    for effect, value, below, above in zip(candidate.effects, theta, moved.below, moved.above, strict=True):
        for term, low, high in zip(effect.terms, below, above, strict=True):
            if low != high:
                basis = Expression(f"(({high}) - ({low}))*{1.0 / moved.step:.10g}")
                terms.append(Term(term.slot, term.axis, basis, term.weight * value))
    of = f"{moved.constant.name} {moved.constant.value:.5g}".strip()
    return Effect(f"{candidate.name}, change of {of}", tuple(terms), "1", candidate.family)


def _shape(effects: Sequence[Effect], theta: Sequence[float], states: States) -> Array:
    """Σ θ φ (N,) over effects, of each along its first term."""
    pairs = zip(effects, theta, strict=True)
    return np.asarray(np.sum([value * e.terms[0].weight * e.terms[0].basis(states) for e, value in pairs], axis=0))
