"""Units at the door: what a header or an option says, in SI."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.errors import InputError
from gpmodel.table.units import convert, factor, known_unit, parse_quantity, split_header
from gpmodel.wording import measured

FACTORS = [
    ("mm", "length", 1e-3), ("m", "length", 1.0), ("um", "length", 1e-6), ("µm", "length", 1e-6),
    ("in", "length", 0.0254), ("deg", "angle", math.pi / 180), ("rad", "angle", 1.0),
    ("arcsec", "angle", math.pi / 648000), ("kg", "mass", 1.0), ("lb", "mass", 0.45359237), ("g", "mass", 1e-3),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "dimension", "expected"), FACTORS)
def test_factor_is_the_si_value_of_one_unit(unit: str, dimension: str, expected: float) -> None:
    assert factor(unit, dimension, "here") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "dimension"),
    [("kg", "length"), ("mm", "angle"), ("1", "angle"), ("1", "length"), ("deg", "length"), ("", "mass"),
     ("percent", "angle"), ("blorp", "length"), ("mm mm", "length"), ("]", "angle"), ("m(", "length")],
)  # fmt: skip
def test_factor_refuses_what_is_no_unit_of_the_dimension(unit: str, dimension: str) -> None:
    with pytest.raises(InputError, match=r"^column 'a': .* write \["):
        factor(unit, dimension, "column 'a'")


@pytest.mark.parametrize(
    ("header", "expected"),
    [("J1 [deg]", ("J1", "deg")), (" x[mm] ", ("x", "mm")), ("load [ 1 ]", ("load", "1")), ("group", ("group", None)),
     ("a b [N*m]", ("a b", "N*m")), ("t []", ("t", "")), ("odd ] name [s]", ("odd ] name", "s"))],
)  # fmt: skip
def test_header_is_name_and_unit(header: str, expected: tuple[str, str | None]) -> None:
    assert split_header(header) == expected


@pytest.mark.parametrize(
    ("unit", "known"),
    [("degC", True), ("1", True), ("s", True), ("kg*m**2/s^2", True), ("m²", True), ("blorp", False), ("(", False),
     ("deg**9999999999", False), ("9**9**9", False), ("9⁹⁹⁹", False), ("m**9**9", False), ("mm*" * 99, False)],
)  # fmt: skip
def test_known_unit(unit: str, known: bool) -> None:
    assert known_unit(unit) is known


@given(st.floats(-1e6, 1e6).map(lambda v: float(f"{v:.6g}")), st.sampled_from(["", " ", "  "]))
def test_quantity_is_number_times_unit(value: float, space: str) -> None:
    assert parse_quantity(f"{value!r}{space}mm", "length", "here") == pytest.approx(value * 1e-3, rel=1e-12)


@pytest.mark.parametrize("text", ["", "mm", "60", "1.2.3mm", "a few mm", "1e5", "60kg", "--3mm", "nan mm"])
def test_quantity_refuses_what_is_no_length(text: str) -> None:
    with pytest.raises(InputError, match=r"^--noise: "):
        parse_quantity(text, "length", "--noise")


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [("2e-7", "rad/Nm", 2e-7), ("2e-7 rad/Nm", "rad/Nm", 2e-7), ("0.2 urad/Nm", "rad/Nm", 2e-7), ("3", "1", 3.0),
     ("20 arcsec", "rad", 20 * math.pi / 648000), ("0.1 mm", "m", 1e-4), (" -1.5 ", "m", -1.5),
     ("5 mm/N", "m/N", 5e-3)],
)  # fmt: skip
def test_value_in_the_units_of_an_effect(text: str, unit: str, expected: float) -> None:
    assert convert(text, unit, "here") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("text", "unit"), [("20 kg", "rad"), ("", "m"), ("x", "m"), ("nan", "m"), ("1 blorp", "m")])
def test_value_that_does_not_convert(text: str, unit: str) -> None:
    with pytest.raises(InputError, match=r"^here: "):
        convert(text, unit, "here")


@pytest.mark.parametrize(
    ("value", "stderr", "unit"),
    [
        (4.043e-8, 7.1e-10, "rad/Nm"),
        (-1.5e-3, 2e-5, "m"),
        (1.2e-5, 3e-7, "1/degC"),
        (1.371e-4, 6.4e-6, "rad*kg*m/Nm"),
        (0.25, None, "1"),
    ],
)
def test_what_a_page_prints_is_read_back(value: float, stderr: float | None, unit: str) -> None:
    printed = str(measured(value, stderr, unit))
    assert convert(printed, unit, "value") == pytest.approx(value, rel=1e-2)
