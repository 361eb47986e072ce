"""Describe formulas of one input in words: a bump, a step or a dead zone, with its centre and width."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import sympy

from gpmodel import wording
from gpmodel.families.candidate import Candidate
from gpmodel.formula.algebra import to_sympy
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect

PRINTED = {"rad": (180.0 / math.pi, "deg"), "m": (1e3, "mm")}
"""Conversion factor and unit in which lengths and angles are printed."""

LINEAR = {"tanh": ("step", 1.0), "logistic": ("step", 2.0), "deadzone": ("dead zone", 2.0)}
"""Word for the shape of each function of (x - at), such as "bump", and the width of the shape if x has factor 1."""


@dataclass(frozen=True)
class Outline:
    """The shape of a formula of one input, with its centre and width in the unit of the input.

    exp(-(x - at)² / (2 width²)) is a bump, tanh((x - at) / width) a step, deadzone(2 (x - at) / width) a dead zone.

    what: shape of the formula: bump, step or dead zone.
    of: name of the input.
    """

    what: str
    of: str
    at: float
    width: float


def outline(basis: Expression) -> Outline | None:
    """Return the shape, centre and width of a basis function, or None if its shape is no bump, step or dead zone."""
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
    """Name unnamed candidates after the shape of their formula, unless two names would be equal.

    A name reads `bump of J2 at -95.5°, width 11.2°`. units: unit of each input.
    """
    named = [_named(candidate, units) for candidate in candidates]
    names = [candidate.name for candidate in named]
    return tuple(new if names.count(new.name) == 1 else old for new, old in zip(named, candidates, strict=True))


def candidate_outline(candidate: Candidate) -> Outline | None:
    """Return the shape of a formula that is a candidate outside the catalogue, or None for any other candidate."""
    one = len(candidate.effects) == 1 and not candidate.family
    basis = candidate.bases[0]
    return outline(basis) if one and isinstance(basis, Expression) else None


def _named(candidate: Candidate, units: Mapping[str, str]) -> Candidate:
    found = candidate_outline(candidate)
    if found is None:
        return candidate
    factor, unit = PRINTED.get(units[found.of], (1.0, units[found.of]))
    said = "°" if unit == "deg" else f" {wording.pretty_unit(unit)}".rstrip()
    at = f"{factor * found.at:.1f}" if units[found.of] in PRINTED else f"{found.at:.4g}"
    name = f"{found.what} of {found.of} at {at}{said}, width {factor * found.width:.3g}{said}"
    effects: tuple[Effect, ...] = tuple(replace(effect, name=name) for effect in candidate.effects)
    return replace(candidate, name=name, effects=effects)
