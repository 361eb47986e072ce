"""Effects of growing links, of which every family of thermal errors is made."""

import math
from collections.abc import Iterator
from itertools import chain

import numpy as np

from gpmodel.arrays import Array
from gpmodel.formula.expression import Basis
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.workspace import links
from gpmodel.model.effect import Effect, Term

EXPANSION = 2e-5
"""Per kelvin: between steel, 12e-6, and aluminium, 23e-6."""

TILT = 2e-5
"""rad per kelvin: a steel column of a metre, 0.3 m wide, whose sides differ by half a kelvin for every kelvin."""

ZERO = 1e-5
"""rad per kelvin of an encoder's zero: Gong 2000 has up to 0.2 mrad over 20 K."""

SHORTEST = 0.02
"""m; a shorter link grows by less than 5 µm in 10 K."""


def arm_growth(
    name: str, mechanism: Mechanism, basis: Basis, unit: str, family: str, prior: float = math.inf
) -> Effect:
    """All links stretch by one share of their lengths."""
    terms = chain(*(_along(slot, link, basis) for slot, link in links(mechanism).items()))
    return Effect(name, tuple(terms), unit, family, prior)


def link_growth(
    name: str, mechanism: Mechanism, basis: Basis, unit: str, family: str, prior: float = math.inf
) -> Iterator[Effect]:
    """Each link alone, but for short ones. name: with {slot} for the slot behind the link."""
    for slot, link in links(mechanism).items():
        if np.linalg.norm(link) > SHORTEST:
            yield Effect(name.format(slot=slot), _along(slot, link, basis), unit, family, prior)


def _along(slot: str, link: Array, basis: Basis) -> tuple[Term, ...]:
    return tuple(Term(slot, f"T{a}", basis, float(v)) for a, v in zip("xyz", link, strict=True) if abs(v) > 1e-9)
