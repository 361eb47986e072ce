"""A frequency grid: a sine and cosine on a drive at more rates than can be named."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import Constant, NonlinearParameters
from gpmodel.mechanism.protocol import Joint

CLOSER = 4
"""Rates in a width of 2π over the travel, within which two are not told apart: between rates a quarter of it apart the
best one loses 5 % at most, (1 - sinc²(1/8))."""


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
        """The candidate at a rate, its constant to so many digits."""
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

    travel: where the joint's coordinate starts, and its range. None where its poses cannot tell two rates apart.
    """
    start, length = travel
    width = 2 * np.pi / length if length > 0 else np.inf
    independent = (span[1] - span[0]) / width
    if not independent > 1:
        return None
    template = replace(wave, cost=wave.cost + float(np.log(independent)))
    return FrequencyGrid(template, joint, start, np.arange(span[0], span[1], width / CLOSER), value, load)
