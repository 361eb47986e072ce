"""Thermal growth of the socket, of the whole measuring loop and of the gap (thesis section 3.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from joints.settings import not_negative, positive


@dataclass(frozen=True)
class LoopPart:
    """One part of the loop from the measuring base to the tool: `length` [m] along the axis, negative where it
    leads back; `expansion` coefficient [1/K]."""

    name: str
    length: float
    expansion: float

    @property
    def growth_per_kelvin(self) -> float:
        """alpha_T L [m/K]."""
        return self.expansion * self.length


def growth(length: ArrayLike, expansion: ArrayLike, temperature_change: ArrayLike) -> Array:
    """alpha_T L dT [m]: 1.17 um/K for the 50.8 mm aluminium socket (the thesis prints "approximately 1")."""
    warmer = np.asarray(temperature_change, np.float64)
    return np.asarray(expansion, np.float64) * np.asarray(length, np.float64) * warmer


def loop_growth(parts: Sequence[LoopPart], temperature_change: ArrayLike) -> Array:
    """Growth [m] of the chain of `parts` when all warm by `temperature_change` [K]."""
    total = sum(part.growth_per_kelvin for part in parts)
    return total * np.asarray(temperature_change, float)


def gap_growth(
    ball_radius: float,
    layer: float,
    ball_expansion: float,
    layer_expansion: float,
    socket_expansion: float,
    temperature_change: ArrayLike,
) -> Array:
    """Growth [m] of the radial gap: the socket bore (radius r + t) and the layer t on it, less the ball."""
    bore = socket_expansion * (positive("ball radius", ball_radius, "m") + not_negative("layer", layer, "m"))
    per_kelvin = bore - layer_expansion * layer - ball_expansion * ball_radius
    return per_kelvin * np.asarray(temperature_change, np.float64)


def allowed_temperature_change(tolerance: ArrayLike, growth_per_kelvin: ArrayLike) -> Array:
    """Temperature change [K] that uses up `tolerance` [m]; inf for a loop that does not grow."""
    rate: Array = np.abs(np.asarray(growth_per_kelvin, float))
    with np.errstate(divide="ignore"):
        return positive("tolerance", tolerance, "m") / rate
