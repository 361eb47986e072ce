"""Laws of one input as a person says them: a bump or a step, where it is and how wide."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy

from gpmodel import wording
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.refinement import STEP, InnerChange, moved
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import Constant, FittedConstant
from gpmodel.formula.algebra import to_sympy
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect

PRINTED = {"rad": (180.0 / math.pi, "deg"), "m": (1e3, "mm")}
"""Factor and unit that lengths and angles are said in."""

LINEAR = {"tanh": ("step", 1.0), "logistic": ("step", 2.0), "deadzone": ("dead zone", 2.0)}
"""Functions of (x - at) that have an outline: what it is, and its width where x counts once."""


@dataclass(frozen=True)
class Outline:
    """A law of one input by its outline: what it is, of which input, where and how wide, in the input's unit.

    exp(-(x - at)² / (2 width²)) is a bump, tanh((x - at) / width) a step, deadzone(2 (x - at) / width) a dead zone.
    """

    what: str
    of: str
    at: float
    width: float


def outline(basis: Expression) -> Outline | None:
    """The outline of a basis, whatever way it is written; None for what is neither."""
    if len(basis.inputs) != 1 or not {"exp", *LINEAR} & set(basis.program.operator_counts):
        return None
    x = sympy.Symbol(basis.inputs[0], real=True)
    law = to_sympy(basis.program)[0]
    function = str(law.func)
    if function not in ("exp", *LINEAR) or not law.args[0].is_polynomial(x):
        return None
    powers = [float(c) for c in sympy.Poly(law.args[0], x).all_coeffs()]
    if function in LINEAR and len(powers) == 2:
        what, width = LINEAR[function]
        return Outline(what, x.name, -powers[1] / powers[0], width / abs(powers[0]))
    if function == "exp" and len(powers) == 3 and powers[0] < 0:
        return Outline("bump", x.name, -powers[1] / (2.0 * powers[0]), 1.0 / math.sqrt(-2.0 * powers[0]))
    return None


def in_words(candidates: Sequence[Candidate], units: Mapping[str, str]) -> tuple[Candidate, ...]:
    """Candidates called by the outline of their law where nobody has named them and no other has the same.

    units: of the inputs. As in `bump of J2 at -95.5°, width 11.2°`.
    """
    named = [_named(candidate, units) for candidate in candidates]
    names = [candidate.name for candidate in named]
    return tuple(new if names.count(new.name) == 1 else old for new, old in zip(named, candidates, strict=True))


def outline_of(candidate: Candidate) -> Outline | None:
    """The outline of a candidate of one effect that is of no family."""
    one = len(candidate.effects) == 1 and not candidate.family
    basis = candidate.bases[0]
    return outline(basis) if one and isinstance(basis, Expression) else None


def _named(candidate: Candidate, units: Mapping[str, str]) -> Candidate:
    found = outline_of(candidate)
    if found is None:
        return candidate
    factor, unit = PRINTED.get(units[found.of], (1.0, units[found.of]))
    said = "°" if unit == "deg" else f" {wording.pretty_unit(unit)}".rstrip()
    at = f"{factor * found.at:.1f}" if units[found.of] in PRINTED else f"{found.at:.4g}"
    name = f"{found.what} of {found.of} at {at}{said}, width {factor * found.width:.3g}{said}"
    effects: tuple[Effect, ...] = tuple(replace(effect, name=name) for effect in candidate.effects)
    return replace(candidate, name=name, effects=effects)


def constants_in_words(
    candidate: Candidate, changes: Sequence[InnerChange], fit: Calibration, units: Mapping[str, str]
) -> Iterator[FittedConstant]:
    """The constants inside a candidate with their deviations; of a law with an outline, where that is and how wide.

    fit: to all poses, with the changes of the constants among its unknowns. units: of the inputs.
    """
    at = [e.name for e in fit.model.effects]
    own = [at.index(change.effect.name) for change in changes]
    constants, deviations = [change.constant for change in changes], np.where(fit.kept[own], fit.stderr[own], np.inf)
    drawn = outline_of(candidate)
    if drawn is None:
        for constant, deviation in zip(constants, deviations.tolist(), strict=True):
            yield FittedConstant(
                constant.name, constant.unit, constant.value, deviation if deviation < np.inf else None
            )
        return
    factor, unit = PRINTED.get(units[drawn.of], (1.0, units[drawn.of]))
    slopes = np.array([_slope(candidate, constant) for constant in constants]).reshape(-1, 2)
    known = bool(changes) and bool(np.isfinite(deviations).all())
    covariance = fit.correlation[np.ix_(own, own)] * np.outer(deviations, deviations) if known else np.zeros((0, 0))
    spread = factor * np.sqrt(np.diag(slopes.T @ covariance @ slopes)) if known else (None, None)
    for name, value, deviation in zip(("position", "width"), (drawn.at, drawn.width), spread, strict=True):
        yield FittedConstant(name, unit, factor * value, None if deviation is None else float(deviation))


def _slope(candidate: Candidate, constant: Constant) -> tuple[float, float]:
    """Change of the position and of the width of an outline per change of a constant."""
    beside = [outline_of(moved(candidate, {constant: constant.value * (1.0 + s)})) for s in (-STEP, STEP)]
    below, above = (o or Outline("", "", math.nan, math.nan) for o in beside)
    step = 2.0 * STEP * constant.value
    return (above.at - below.at) / step, (above.width - below.width) / step
