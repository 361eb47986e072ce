"""Families of two inputs, for what is left: products of low harmonics of two angles, torque or angle times a column."""

from collections.abc import Iterator
from functools import cache
from itertools import combinations

from gpmodel.families.candidate import Candidate, loaded, one, revolute
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.sites import Site, sites_of
from gpmodel.model.states import States

HARMONICS = (1, 2)
"""Harmonics of each angle in a product of two: gears are eccentric (1) and elliptic (2)."""
COST = 8.0
"""Nats of a product of two inputs: e^8 = 3000, about as many as there are on an arm of six joints."""


@cache
def product(first: str, second: str) -> tuple[tuple[Expression, float], ...]:
    """sin and cos of n q_i times those of m q_j, and the deviation 1 / (n m) of each, parsed once."""
    return tuple(
        (Expression(f"{f}({n}*{first})*{g}({m}*{second})"), 1.0 / (n * m))
        for n in HARMONICS
        for m in HARMONICS
        for f in ("sin", "cos")
        for g in ("sin", "cos")
    )


def products(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """sin and cos of n q_i times those of m q_j, n and m up to two, at every place."""
    for site in sites_of(mechanism):
        for first, second in combinations(revolute(mechanism), 2):
            name = f"{site.name} following {first.name} and {second.name}"
            effects = [
                Effect(f"{name}, {basis}", site.effect("", basis, "").terms, "rad", "interaction", deviation)
                for basis, deviation in product(first.name, second.name)
            ]
            yield Candidate(name, tuple(effects), "interaction", COST)


def varying(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Own torque or own harmonic times a column of the session: stiffness and curves that change with it."""
    columns = [c for c in states.columns if states.units[c] in ("degC", "K") or c in ("row", "time", "payload")]
    for column in columns:
        middle, span = float(states[column].mean()), float(states[column].std()) or 1.0
        scaled = f"(({column} - {middle:.6g})/{span:.4g})"
        for j in revolute(mechanism):
            torque = f"torque_{j.name}"
            if loaded(states, torque):
                name = f"compliance of {j.name} changing with {column}"
                effect = Site(j.drive).effect(name, Expression(f"{torque}*{scaled}"), "rad", "changing")
                yield one(name, effect, COST)
            name = f"eccentricity of {j.name} changing with {column}"
            effects = [
                Site(j.drive).effect(f"{name}, {f}", Expression(f"{f}({j.name})*{scaled}"), "rad", "changing")
                for f in ("sin", "cos")
            ]
            yield Candidate(name, tuple(effects), "changing", COST)
