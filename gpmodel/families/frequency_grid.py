"""Waves of a joint at more rates than can be named, and the families that are such: ripple, mesh compliance."""

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
"""Frequencies per 2π over the travel. At a quarter of that spacing the best one loses at most 5 % of the gain, 1 -
sinc²(1/8)."""


@dataclass(frozen=True)
class FrequencyGrid:
    """sin and cos of rate · (q - start) on the drive of a joint, times a load where there is one, at every rate of a
    range.

    template: the candidate with a symbol in the place of what its name tells the rate by. rates: (F,) rad of the
    argument per rad or metre of the joint's coordinate, equally spaced. value: what stands for the symbol at a rate,
    and the rate of that. load: the column of it.
    Its cost is that of a named effect and the log of how many of the rates the poses can tell apart.
    """

    template: Candidate
    joint: Joint
    start: float
    rates: Array
    value: Callable[[float], float]
    load: str = ""

    @property
    def step(self) -> float:
        """Between two rates."""
        return float(self.rates[1] - self.rates[0])

    def at(self, rate: float, digits: int = 6) -> Candidate:
        """Return the candidate at a frequency, rounded to so many digits."""
        value = float(f"{self.value(rate):.{digits}g}")
        inner = NonlinearParameters(self.template.name, self.template.effects, (Constant("rate", "1", value),))
        return replace(self.template, name=inner.full_name, effects=inner.effects, inner=inner)


def frequency_grid(
    wave: Candidate,
    joint: Joint,
    travel: tuple[float, float],
    span: tuple[float, float],
    value: Callable[[float], float],
    load: str = "",
) -> FrequencyGrid | None:
    """The grid of a wave written with a symbol, over rates from span[0] to span[1], rad per rad or metre.

    travel: where the joint's coordinate starts, and its range. None where the range is too short
    to tell two rates apart.
    """
    start, length = travel
    width = 2 * np.pi / length if length > 0 else np.inf
    independent = (span[1] - span[0]) / width
    if not independent > 1:
        return None
    template = replace(wave, cost=wave.cost + float(np.log(independent)))
    return FrequencyGrid(template, joint, start, np.arange(span[0], span[1], width / CLOSER), value, load)


NAMED, HIGHEST = range(3, 13), 400
"""Ripples per turn offered by name; and the largest number per turn, whole or not, that is searched: twice the ratio of
the slowest strain-wave gears."""
COST = 4.0
"""Price of an effect with a name, nats."""


def transmission_ripple(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Three to twelve per turn of each revolute joint, rad."""
    for j in revolute(mechanism):
        yield from (_ripple("transmission_ripple", j, n, COST + float(np.log(NAMED[-1]))) for n in NAMED)


def mesh_compliance(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the named ripples times the joint's torque, rad/Nm."""
    for j, load in _loaded(mechanism, states):
        yield from (_ripple("mesh_compliance", j, n, COST + float(np.log(NAMED[-1])), load) for n in NAMED)


def ripple_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """Any number per turn, whole or not, up to HIGHEST; of fewer than two waves over the travel the curves tell."""
    for j in revolute(mechanism):
        yield from _grid(_ripple("transmission_ripple", j, symbol(), COST), j, states)


def mesh_grids(mechanism: Mechanism, states: States) -> Iterator[FrequencyGrid]:
    """Yield the ripple grids times the joint's torque."""
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
