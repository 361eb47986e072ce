"""Orifice laws: contracts over both."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from joints.orifice import ATMOSPHERE, SCCM, LinearOrifice, NozzleOrifice, Orifice

ORIFICES: list[Orifice] = [LinearOrifice(), NozzleOrifice(50.8e-6, 1.0), NozzleOrifice(2e-4, 0.7)]
IDS = ["linear", "nozzle", "wide nozzle"]
SOCKET = 0.5 * ATMOSPHERE


@pytest.mark.parametrize("orifice", ORIFICES, ids=IDS)
def test_inlet_pressure_inverts_flow(orifice: Orifice) -> None:
    inlet = np.array([0.7, 1.2, 3.0, 6.0]) * ATMOSPHERE
    assert orifice.inlet_pressure(orifice.flow(inlet, SOCKET), SOCKET) == pytest.approx(inlet, rel=1e-9)


@pytest.mark.parametrize("orifice", ORIFICES, ids=IDS)
@pytest.mark.parametrize("inlet", [0.8, 1.3, 4.0])
def test_flow_slope_is_the_derivative(orifice: Orifice, inlet: float) -> None:
    supply, step = inlet * ATMOSPHERE, 1.0
    flows = orifice.flow(supply, np.array([SOCKET - step, SOCKET + step]))
    assert float(orifice.flow_slope(supply, SOCKET)) == pytest.approx((flows[1] - flows[0]) / (2 * step), rel=1e-6)
    assert float(orifice.flow_slope(supply, SOCKET)) <= 0


def test_nozzle_chokes_at_the_critical_ratio() -> None:
    """A sonic orifice of 0.002 in feeds about what Table 4.2 says it does: 173.9 sccm at 5.9 atm."""
    nozzle = NozzleOrifice(50.8e-6, 1.0)
    supply = 5.9 * ATMOSPHERE
    choked = 0.528 * (supply + ATMOSPHERE) - ATMOSPHERE
    assert float(nozzle.flow(supply, 0.0)) == pytest.approx(float(nozzle.flow(supply, choked)), rel=1e-6)
    assert float(nozzle.flow(supply, supply)) == 0.0
    assert float(nozzle.flow(supply, SOCKET)) / SCCM == pytest.approx(173.9, rel=0.06)


def test_choked_flow_is_the_textbook_mass_flow() -> None:
    """m = A p0 sqrt(k/(R T)) (2/(k+1))^((k+1)/(2(k-1)))."""
    supply, temperature = 6 * ATMOSPHERE, 293.15
    mass = np.pi * 50e-6**2 / 4 * (supply + ATMOSPHERE) * np.sqrt(1.4 / (287.05 * temperature)) * (2 / 2.4) ** 3
    density = ATMOSPHERE / (287.05 * temperature)
    assert float(NozzleOrifice(50e-6, 1.0).flow(supply, 0.0)) == pytest.approx(mass / density, rel=1e-9)


@pytest.mark.parametrize("orifice", ORIFICES, ids=IDS)
def test_impossible_pressures_are_refused(orifice: Orifice) -> None:
    with pytest.raises(InputError, match="inlet pressure = -1, expected at least 0 Pa"):
        orifice.flow(-1.0, 0.0)
    with pytest.raises(InputError, match="expected at least the socket pressure"):
        orifice.flow(1e5, 2e5)
    with pytest.raises(InputError, match="flow = -1"):
        orifice.inlet_pressure(-1.0, 0.0)


def test_impossible_orifices_are_refused() -> None:
    with pytest.raises(InputError, match="orifice slope = 0"):
        LinearOrifice(0.0, 0.0)
    with pytest.raises(InputError, match="orifice diameter = -1"):
        NozzleOrifice(-1.0)
    with pytest.raises(InputError, match=r"discharge coefficient = 1.5, expected above 0 and at most 1"):
        NozzleOrifice(1e-4, 1.5)
