"""Specifications by makers of instruments, read from text."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.table.specification import COVERAGE, Specification, specification


@pytest.mark.parametrize(
    ("text", "offset", "slope"),
    [
        ("15um + 6um/m", 15e-6, 6e-6),
        ("±(15 µm + 6 µm/m)", 15e-6, 6e-6),
        ("10 µm + 5 ppm", 10e-6, 5e-6),
        ("6um/m+15um", 15e-6, 6e-6),
        ("0.02mm", 20e-6, 0.0),
        ("6 um/m", 0.0, 6e-6),
        ("7e+1 um + 1e-3 mm/m", 70e-6, 1e-6),
    ],
)
def test_a_limit_is_an_offset_and_a_slope(text: str, offset: float, slope: float) -> None:
    for said in (text, str(specification(text))):
        found = specification(said)
        assert (found.offset, found.slope) == (pytest.approx(offset), pytest.approx(slope))


@pytest.mark.parametrize(
    "text", ["15", "Leica", "", "15um - 3um/m", "15deg", "5um/kg", "0 mm", "15um +", "2m", "2 m/m"]
)
def test_other_text_is_refused_in_one_line_that_says_what_was_expected(text: str) -> None:
    with pytest.raises(InputError) as caught:
        specification(text)
    assert caught.value.argument == "instrument"
    assert "as in '15um + 6um/m'" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_limit_is_that_of_the_typical_distance_of_the_points_that_were_measured() -> None:
    points = np.array([[3.0, 0.0, 0.0], [0.0, -3.0, 0.0], [np.nan, 1.0, 1.0]])
    stated = Specification(15e-6, 6e-6)
    assert stated.at(points) == pytest.approx(33e-6)
    assert stated.noise(points) == pytest.approx(33e-6 / COVERAGE)
