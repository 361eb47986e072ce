"""Families of compliances on arms whose masses nobody knows, or knows wrongly.

Gravity's torque about a joint is linear in the first moments of mass of the links beyond it, so a compliance with
unknown masses is one group: an unknown per link and axis, each compliance times moment.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate, revolute
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, Term, drive_effect
from gpmodel.model.states import States

DEFLECTION = 7e-4
"""rad; a shoulder of 4e6 N·m/rad under 3 kN·m, a forearm of 2e5 under 140 (Dumas 2011)."""


def unknown_masses(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """The drive of each joint under unit moments of every link beyond it."""
    for j in revolute(mechanism):
        prefix = f"torque_{j.name}_of_"
        moments = [n for n in _unit_loads(states) if n.startswith(prefix) and n.endswith(("_x", "_y", "_z"))]
        if moments:
            name = f"compliance with unknown masses, {j.name}"
            prior = _share(states, moments)
            said = ((f"{name}, moment of {m.removeprefix(prefix)}", Expression(m)) for m in moments)
            effects = (drive_effect(n, j, basis, "rad·kg·m/Nm", "unknown_masses", prior) for n, basis in said)
            yield Candidate(name, tuple(effects), "unknown_masses", 5.0)


def base_unknown_masses(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """The base tilts about x and y under unit moments of every link: one unknown for both axes, as it is round."""
    loads, prefix = _unit_loads(states), "moment_base_x_of_"
    moments = [n for n in loads if n.startswith(prefix) and n.replace("moment_base_x", "moment_base_y") in loads]
    if moments:
        name = "base compliance with unknown masses"
        effects = tuple(
            Effect(
                f"{name}, {m.removeprefix('moment_base_x_of_')}",
                tuple(
                    Term("base", f"R{a}", Expression(m.replace("moment_base_x", f"moment_base_{a}"))) for a in "xy"
                ),
                "rad·kg·m/Nm", "base_unknown_masses", _share(states, moments),
            )
            for m in moments
        )  # fmt: skip
        yield Candidate(name, effects, "base_unknown_masses", 5.0)


def wrong_masses(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """The drive of each joint under the weight of each link beyond it, every link with a number of its own."""
    for j in revolute(mechanism):
        prefix = f"torque_{j.name}_of_"
        parts = [n for n in _unit_loads(states) if n.startswith(prefix) and not n.endswith(("_x", "_y", "_z"))]
        if len(parts) > 1:
            name = f"compliance with wrong masses, {j.name}"
            prior = DEFLECTION / max(float(np.max(np.abs(sum(_unit_loads(states)[n] for n in parts)))), 1e-9)
            effects = tuple(
                drive_effect(
                    f"{name}, weight of {n.removeprefix(prefix)}", j, Expression(n), "rad/Nm", "wrong_masses", prior
                )
                for n in parts
            )
            yield Candidate(name, effects, "wrong_masses", 5.0)


def _unit_loads(states: States) -> Mapping[str, Array]:
    return states.weights.columns if states.weights else {}


def _share(states: States, moments: list[str]) -> float:
    """The prior of each moment with which all of them together deflect the joint as much as is usual."""
    squares = sum(float(np.mean(_unit_loads(states)[m] ** 2)) for m in moments)
    return DEFLECTION / float(np.sqrt(squares))
