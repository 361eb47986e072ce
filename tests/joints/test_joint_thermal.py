"""Thermal growth."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from joints.thermal import LoopPart, allowed_temperature_change, gap_growth, growth, loop_growth


def test_socket_column_grows_1_17_micrometres_a_degree() -> None:
    """The thesis prints "approximately 1 um" for 2 in of aluminium."""
    assert round(float(growth(50.8e-3, 23e-6, 1.0)) * 1e6, 2) == 1.17


def test_loop_adds_parts_and_lets_a_returning_part_compensate() -> None:
    out, back = LoopPart("out", 0.1, 23e-6), LoopPart("back", -0.1, 12e-6)
    assert loop_growth([out, back], [0.0, 2.0]) == pytest.approx([0.0, 2 * 0.1 * 11e-6])


def test_one_material_keeps_the_gap_in_proportion() -> None:
    assert float(gap_growth(0.025, 0.0, 12e-6, 50e-6, 12e-6, 10.0)) == pytest.approx(0, abs=1e-15)


def test_gap_of_aluminium_socket_and_steel_ball_opens_when_warm() -> None:
    rate = float(gap_growth(25.4e-3, 1.8e-3, 12e-6, 50e-6, 23e-6, 1.0))
    assert rate == pytest.approx(25.4e-3 * 11e-6 + 1.8e-3 * (23e-6 - 50e-6))
    assert rate > 0


def test_allowed_change_uses_up_the_tolerance() -> None:
    change = allowed_temperature_change(1e-6, [2e-6, -0.5e-6, 0.0])
    assert change == pytest.approx([0.5, 2.0, np.inf])


def test_tolerance_must_be_above_zero() -> None:
    with pytest.raises(InputError, match="tolerance = 0, expected above 0 m"):
        allowed_temperature_change(0.0, 1e-6)
