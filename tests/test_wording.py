import math

import pytest

from gpmodel import wording


@pytest.mark.parametrize(
    ("value", "deviation", "unit", "text"),
    [
        (2.51e-4, 4.2e-6, "rad", "251.0 ± 4.2 µrad"),
        (-1.5e-3, 2.0e-5, "m", "−1.500 ± 0.020 mm"),
        (4.83e-8, 2.1e-9, "rad/Nm", "48.3 ± 2.1 nrad/(N·m)"),
        (2.0e-6, 3.0e-5, "m", "2 ± 30 µm"),
        (1.2e-5, 3e-7, "1/degC", "12.00 ± 0.30 ×10⁻⁶ 1/°C"),
        (0.25, 0.01, "1", "0.250 ± 0.010"),
        (0.0, None, "m", "0 m"),
        (2.51e-4, None, "rad", "251 µrad"),
        (None, None, "rad", "– rad"),
        (math.nan, 1.0, "rad", "– rad"),
    ],
)
def test_value_and_deviation_share_prefix_and_decimals(
    value: float | None, deviation: float | None, unit: str, text: str
) -> None:
    assert str(wording.measured(value, deviation, unit)) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("2*J4**3", "2·J4³"),
        ("sin(2*J4 +0.412)", "sin(2·J4 + 0.412)"),
        ("a - 1", "a − 1"),
        ("-2*α-Drehung - 1e-5*(-J1)", "−2·α-Drehung − 1e−5·(−J1)"),
        ("x**y", "x**y"),
    ],
)
def test_expression_for_reading(text: str, shown: str) -> None:
    assert wording.expression(text) == shown


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.003124, "0.00312"), (0.0, "0"), (0.0312, "0.031"), (12.345, "12.35"), (None, "–"), (math.nan, "–")],
)
def test_millimetres(value: float | None, text: str) -> None:
    assert wording.millimetres(value) == text


@pytest.mark.parametrize(
    ("probability", "text"), [(0.0123, "0.012"), (1e-90, "< 0.000001"), (0.0, "< 0.000001"), (None, "–")]
)
def test_chance(probability: float | None, text: str) -> None:
    assert wording.chance(probability) == text


@pytest.mark.parametrize(("share", "text"), [(0.931, "93 %"), (0.004, "0.4 %"), (0.0, "0 %"), (None, "–")])
def test_percent(share: float | None, text: str) -> None:
    assert wording.percent(share) == text


@pytest.mark.parametrize(
    ("name", "length", "said"),
    [
        ("J1 Tx", 9, "J1 Tx"),
        ("shoulder_pan_joint Tx", 19, "shoulder_pan_jo… Tx"),
        ("shoulder_pan_joint Ty", 19, "shoulder_pan_jo… Ty"),
        ("backlash_of_the_first", 9, "backlash…"),
    ],
)
def test_a_parameter_keeps_its_axis_when_its_name_is_shortened(name: str, length: int, said: str) -> None:
    assert wording.short_name(name, length) == said


def test_consecutive_numbers_are_written_as_ranges() -> None:
    assert wording.ranges([1, 2, 4, 5, 6, 9]) == ["1", "2", "4 to 6", "9"]
    assert wording.ranges([]) == []
