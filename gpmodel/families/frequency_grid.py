"""Sinusoidal errors of a joint at any frequency of a range: transmission ripple and gear mesh compliance."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate, loaded, revolute
from gpmodel.families.inner import Constant, NonlinearParameters, symbol
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.model.effect import drive_effect
from gpmodel.model.states import States

CLOSER = 4
"""Number of trial frequencies per 2π over the travel of a joint. Between two trial frequencies the explained variance
falls by at most 5 %, 1 - sinc²(1/8)."""


@dataclass(frozen=True)
class FrequencyGrid:
    """Harmonics sin and cos of rate · (q - start) of a joint coordinate q on the joint's drive, for a grid of rates.

    template: harmonic as a candidate, with a symbol for the number in its name. The penalty of the candidate is that of
    a named effect plus the log of the number of rates that the poses resolve.
    start: coordinate q at which the phase is zero, rad or m.
    rates: equally spaced rates, rad of the argument per rad or metre of the coordinate.
    value: function from a rate to the number in the candidate's name, and its inverse.
    load: column of the load that multiplies the harmonic, empty if none. called: unit of the number in the name.
    """

    template: Candidate
    joint: Joint
    start: float
    rates: Array
    value: Callable[[float], float]
    load: str = ""
    called: tuple[str, str] = ("number per turn", "1")

    @property
    def step(self) -> float:
        """Difference between two neighbouring rates of the grid."""
        return float(self.rates[1] - self.rates[0])

    def at(self, rate: float, digits: int = 6) -> Candidate:
        """Return the candidate harmonic at a given rate, with the number in its name rounded to `digits` digits."""
        value = float(f"{self.value(rate):.{digits}g}")
        inner = NonlinearParameters(self.template.name, self.template.effects, (Constant(*self.called, value),))
        return replace(self.template, name=inner.full_name, effects=inner.effects, inner=inner)


def frequency_grid(
    wave: Candidate,
    joint: Joint,
    travel: tuple[float, float],
    span: tuple[float, float],
    value: Callable[[float], float],
    load: str = "",
) -> FrequencyGrid | None:
    """Return a grid of frequencies for a harmonic `wave` with a symbol, from span[0] to span[1], rad per rad or metre.

    None is returned if the joint's travel is too short to resolve two rates of the range.

    travel: lowest coordinate of the joint, and its range, rad or m.
    value, load: as in `FrequencyGrid`.
    """
    start, length = travel
    width = 2 * np.pi / length if length > 0 else np.inf
    independent = (span[1] - span[0]) / width
    if not independent > 1:
        return None
    template = replace(wave, cost=wave.cost + float(np.log(independent)))
    return FrequencyGrid(template, joint, start, np.arange(span[0], span[1], width / CLOSER), value, load)


NAMED, HIGHEST = range(3, 13), 400
"""Numbers of ripples per turn that the catalogue names; and the largest searched number per turn, whole or not: twice
the ratio of the slowest strain-wave gears."""
COST = 4.0
"""Penalty in the selection of an effect that the catalogue names, nats."""


def transmission_ripple(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield three to twelve ripples per turn of each revolute joint, rad."""
    for j in revolute(mechanism):
        yield from (_ripple("transmission_ripple", j, n, COST + float(np.log(NAMED[-1]))) for n in NAMED)


def mesh_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield three to twelve ripples per turn of each revolute joint, multiplied by its torque, rad/Nm."""
    for j, load in _loaded(mechanism, states):
        yield from (_ripple("mesh_compliance", j, n, COST + float(np.log(NAMED[-1])), load) for n in NAMED)


def ripple_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """Yield ripples of each revolute joint at any number per turn up to HIGHEST, whole or not.

    Error curves describe slower ripples, of fewer than two periods over the travel.
    """
    for j in revolute(mechanism):
        yield from _grid(_ripple("transmission_ripple", j, symbol(), COST), j, states)


def mesh_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """Yield ripples of each loaded revolute joint at any number per turn, multiplied by the torque of the joint."""
    for j, load in _loaded(mechanism, states):
        yield from _grid(_ripple("mesh_compliance", j, symbol(), COST, load), j, states, load)


def _loaded(mechanism: Mechanism, states: States) -> Iterator[tuple[Joint, str]]:
    """Yield the revolute joints under a load, with the column of the load."""
    torques = ((j, f"torque_{j.name}") for j in revolute(mechanism))
    return ((j, torque) for j, torque in torques if loaded(states, torque))


def _ripple(family: str, j: Joint, number: object, cost: float, load: str = "") -> Candidate:
    """Return a candidate of sine and cosine of `number` periods per turn of a joint. load: column as a factor."""
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
