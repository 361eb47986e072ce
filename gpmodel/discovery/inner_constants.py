"""Constants inside a law as unknowns of the last fit: what a change of one does is a column like any other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, Term
from gpmodel.model.states import States

STEP = 1e-3
"""Of the difference that stands for the derivative, in the constant itself."""

OWN = 0.05
"""Share of a change's column that the law's own columns must leave: a scale is its coefficient said again."""

MOST = 0.3
"""How much of itself over the poses a law is believed to be changed by: beyond that its column does not say how."""

FITTED = ("", "transmission_ripple", "cyclic_error", "warm_up", "settling")
"""Families whose bases have a constant that was chosen from many; what nobody named has nothing else."""

HARMONICS = 12
"""Whole numbers up to this are how often per turn, not constants that were fitted."""


@dataclass(frozen=True)
class _Moved:
    """A constant and the bases (E, terms) of a candidate's effects where it is smaller and larger by half a step."""

    value: float
    below: tuple[tuple[str, ...], ...]
    above: tuple[tuple[str, ...], ...]
    step: float


def inner_changes(candidate: Candidate, fit: Calibration, states: States) -> tuple[Effect, ...]:
    """The change of each constant inside a law, as an effect whose unknown is that change: θ ∂φ/∂c.

    With them in the model the deviations of the law's coefficient and of what it predicts are those of a nonlinear
    least-squares fit, and each constant has one of its own. Constants that the coefficient or the geometry can stand
    for have none. Source: Seber and Wild (1989), 2.1.
    """
    values = dict(zip((e.name for e in fit.model.effects), fit.theta.tolist(), strict=True))
    theta = [values[e.name] for e in candidate.effects]
    law = _shape(candidate.effects, theta, states)
    taken = [np.ones(len(states)), *(_shape([e], [1.0], states) for e in candidate.effects)]
    out: list[Effect] = []
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
        out.append(Effect(effect.name, effect.terms, effect.unit, effect.family, prior))
    return tuple(out)


def _moved(candidate: Candidate) -> Iterator[_Moved]:
    """Each distinct constant of the candidate's bases; one that several of them share moves in all of them."""
    if candidate.family not in FITTED or candidate.has_priors:
        return
    texts = _texts(candidate.effects)
    programs = [Expression(text).program for own in texts for text in own]
    for value in dict.fromkeys(c for program in programs for c in program.constants):
        if value == round(value) and abs(value) <= HARMONICS:
            continue
        step = STEP * abs(value)
        below, above = (
            tuple(tuple(_with(text, value, value + side * step / 2) for text in own) for own in texts)
            for side in (-1, 1)
        )
        yield _Moved(value, below, above, step)


def _with(text: str, value: float, new: float) -> str:
    program = Expression(text).program
    return program.with_constants([new if c == value else c for c in program.constants]).written_out()


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
    return Effect(f"{candidate.name}, change of {moved.value:.5g}", tuple(terms), "1", candidate.family)


def _shape(effects: Sequence[Effect], theta: Sequence[float], states: States) -> Array:
    """Σ θ φ (N,) over effects, of each along its first term."""
    pairs = zip(effects, theta, strict=True)
    return np.sum([value * e.terms[0].weight * e.terms[0].basis(states) for e, value in pairs], axis=0)
