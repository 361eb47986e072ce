"""Ripples of a transmission: waves over a joint's angle as teeth pass, at any load and in proportion to it.

n per turn of the joint, τ its torque by gravity:  a sin nq + b cos nq, rad;  τ (a sin nq + b cos nq), a, b in rad/Nm.
"""

from collections.abc import Iterator

import numpy as np

from gpmodel.families.candidate import Candidate, loaded, revolute
from gpmodel.families.frequency_grid import FrequencyGrid, frequency_grid
from gpmodel.families.inner import symbol
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.model.effect import drive_effect
from gpmodel.model.states import States

NAMED, HIGHEST = range(3, 13), 400
"""Ripples per turn that are offered by name; up to where any number, whole or not, is looked for: twice the ratio of
the slowest strain-wave gears."""
COST = 4.0
"""Nats of an effect with a name."""


def transmission_ripple(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Three to twelve per turn of each revolute joint, rad."""
    for j in revolute(mechanism):
        yield from (_ripple("transmission_ripple", j, n, COST + float(np.log(NAMED[-1]))) for n in NAMED)


def mesh_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """The same times the joint's torque, rad/Nm."""
    for j, load in _loaded(mechanism, states):
        yield from (_ripple("mesh_compliance", j, n, COST + float(np.log(NAMED[-1])), load) for n in NAMED)


def ripple_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """Any number per turn, whole or not, up to HIGHEST; of fewer than two waves over the travel the curves tell."""
    for j in revolute(mechanism):
        yield from _grid(_ripple("transmission_ripple", j, symbol(), COST), j, states)


def mesh_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """The same times the joint's torque."""
    for j, load in _loaded(mechanism, states):
        yield from _grid(_ripple("mesh_compliance", j, symbol(), COST, load), j, states, load)


def _loaded(mechanism: Mechanism, states: States) -> Iterator[tuple[Joint, str]]:
    """Revolute joints that carry a load, with the column of it."""
    torques = ((j, f"torque_{j.name}") for j in revolute(mechanism))
    return ((j, torque) for j, torque in torques if loaded(states, torque))


def _ripple(family: str, j: Joint, number: object, cost: float, load: str = "") -> Candidate:
    """Sine and cosine of so many per turn."""
    name = f"{family.replace('_', ' ')}, {number} per turn, {j.name}"
    times, unit = (f"{load}*", "rad/Nm") if load else ("", "rad")
    waves = {f: Expression(f"{times}{f}({number}*{j.name})") for f in ("sin", "cos")}
    effects = tuple(drive_effect(f"{name}, {f}", j, wave, unit, family) for f, wave in waves.items())
    return Candidate(name, effects, family, cost)


def _grid(template: Candidate, j: Joint, states: States, load: str = "") -> Iterator[FrequencyGrid]:
    travel = float(np.ptp(states[j.name]))
    lowest = max(float(NAMED[0]), 4 * np.pi / travel) if travel > 0 else np.inf
    found = frequency_grid(template, j, (0.0, travel), (lowest, HIGHEST), lambda rate: rate, load)
    if found is not None:
        yield found
