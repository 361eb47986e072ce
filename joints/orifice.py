"""Orifices that feed an air film: pressure drop against flow.

Pressures are gauge [Pa], flows are volumes of air at atmospheric pressure [m^3/s] through one orifice.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from joints.settings import not_negative, positive, require

ATMOSPHERE = 101325.0
SCCM = 1e-6 / 60


class Orifice(Protocol):
    """Flow through one orifice from the `inlet` pressure to the `socket` pressure in the film [Pa, gauge]."""

    def flow(self, inlet: ArrayLike, socket: ArrayLike) -> Array:
        """Return the flow [m^3/s at atmospheric pressure] from the inlet pressure to the socket pressure."""

    def inlet_pressure(self, flow: ArrayLike, socket: ArrayLike) -> Array:
        """Return the inlet pressure [Pa] that drives `flow` through the orifice."""

    def flow_slope(self, inlet: ArrayLike, socket: ArrayLike) -> Array:
        """Return the derivative of flow by socket pressure [m^3/(s Pa)], at most 0, at constant inlet pressure."""


@dataclass(frozen=True)
class LinearOrifice:
    """An orifice with the pressure drop max(0, `slope` flow - `offset`): slope [Pa s/m^3], offset [Pa].

    The defaults reproduce the orifice and inlet columns of Table 4.2: drop [atm] = 0.03445 flow [sccm] - 0.638.
    """

    slope: float = 0.03445 * ATMOSPHERE / SCCM
    offset: float = 0.638 * ATMOSPHERE

    def __post_init__(self) -> None:
        positive("orifice slope", self.slope, "Pa s/m^3")
        not_negative("orifice offset", self.offset, "Pa")

    def flow(self, inlet: ArrayLike, socket: ArrayLike) -> Array:
        return (_drop(inlet, socket) + self.offset) / self.slope

    def inlet_pressure(self, flow: ArrayLike, socket: ArrayLike) -> Array:
        drop = np.maximum(self.slope * not_negative("flow", flow, "m^3/s") - self.offset, 0.0)
        return not_negative("socket pressure", socket, "Pa") + drop

    def flow_slope(self, inlet: ArrayLike, socket: ArrayLike) -> Array:
        return np.full_like(_drop(inlet, socket), -1 / self.slope)


@dataclass(frozen=True)
class NozzleOrifice:
    """Isentropic nozzle of `diameter` [m] and `discharge` coefficient, air at `temperature` [K] (form of ISO 6358).

    Flow C_d A (p_u / p_a) sqrt(R T) psi(p_d / p_u): discharge coefficient C_d, area A, gas constant R, temperature T,
    and absolute pressures p_u upstream, p_d downstream, p_a of the atmosphere. psi = 0.685 for p_d / p_u below 0.528.
    """

    diameter: float
    discharge: float = 0.8
    temperature: float = 293.15

    def __post_init__(self) -> None:
        positive("orifice diameter", self.diameter, "m")
        require(0 < self.discharge <= 1, "discharge coefficient", self.discharge, "above 0 and at most 1")
        positive("air temperature", self.temperature, "K")

    def flow(self, inlet: ArrayLike, socket: ArrayLike) -> Array:
        _drop(inlet, socket)
        upstream = np.asarray(inlet, float) + ATMOSPHERE
        ratio = (np.asarray(socket, float) + ATMOSPHERE) / upstream
        return self._capacity * upstream / ATMOSPHERE * _discharge_function(ratio)

    def inlet_pressure(self, flow: ArrayLike, socket: ArrayLike) -> Array:
        """Return the inlet pressure [Pa] that drives `flow`, by bisection between zero flow and choked flow. The flow
        grows with inlet pressure, so bisection converges."""
        target, socket_pressure = np.broadcast_arrays(
            not_negative("flow", flow, "m^3/s"), not_negative("socket pressure", socket, "Pa")
        )
        choked = target / (self._capacity * _discharge_function(np.zeros(()))) * ATMOSPHERE
        low: Array = socket_pressure.astype(float)
        high: Array = np.maximum(choked, (socket_pressure + ATMOSPHERE) / _CRITICAL) - ATMOSPHERE
        for _ in range(80):
            middle = (low + high) / 2
            short = self.flow(middle, socket_pressure) < target
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return (low + high) / 2

    def flow_slope(self, inlet: ArrayLike, socket: ArrayLike) -> Array:
        """Return the derivative of the flow with respect to the socket pressure [m^3/(s Pa)]; zero for a choked
        orifice."""
        _drop(inlet, socket)
        ratio = (np.asarray(socket, float) + ATMOSPHERE) / (np.asarray(inlet, float) + ATMOSPHERE)
        return self._capacity / ATMOSPHERE * _discharge_slope(ratio)

    @property
    def _capacity(self) -> float:
        return float(self.discharge * np.pi * self.diameter**2 / 4 * np.sqrt(_GAS_CONSTANT * self.temperature))


_GAS_CONSTANT = 287.05
_HEAT_RATIO = 1.4
_CRITICAL = (2 / (_HEAT_RATIO + 1)) ** (_HEAT_RATIO / (_HEAT_RATIO - 1))


def _discharge_function(ratio: Array) -> Array:
    """Return the discharge function sqrt(2 k/(k-1) (x^(2/k) - x^((k+1)/k))), x: pressure ratio, k: heat ratio."""
    x = np.clip(ratio, _CRITICAL, 1.0)
    k = _HEAT_RATIO
    return np.sqrt(2 * k / (k - 1) * (x ** (2 / k) - x ** ((k + 1) / k)))


def _discharge_slope(ratio: Array) -> Array:
    x = np.clip(ratio, _CRITICAL, 1.0 - 1e-12)
    k = _HEAT_RATIO
    slope = (x ** (2 / k - 1) * 2 / k - x ** (1 / k) * (k + 1) / k) * k / (k - 1) / _discharge_function(x)
    return np.where(ratio > _CRITICAL, slope, 0.0)


def _drop(inlet: ArrayLike, socket: ArrayLike) -> Array:
    upstream = not_negative("inlet pressure", inlet, "Pa")
    downstream = not_negative("socket pressure", socket, "Pa")
    drop = upstream - downstream
    require(drop >= 0, "inlet pressure", upstream, "at least the socket pressure")
    return drop
