"""Laws at a known place: drawn alike each time, exact without noise, and the page has the numbers of the file."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.recovery import at_place

HERE = Path(at_place.__file__).parent


@pytest.mark.parametrize("factors", [1, 2])
def test_a_place_is_always_the_same_and_its_truth_predicts_best(factors: int) -> None:
    place, again = at_place.drawn(factors, 3), at_place.drawn(factors, 3)
    assert place.text == again.text
    np.testing.assert_array_equal(place.measured, again.measured)
    noise = float(np.std(place.measured - place.exact))
    assert place.error(place.truth) < noise < place.error(np.zeros_like(place.truth))


def test_a_law_that_was_found_is_judged_at_poses_it_never_saw() -> None:
    row = at_place.judged(1, 1)
    assert row["found"]
    assert row["nodes"] > 0
    assert 0.5 < row["ratio"] < 5.0


def test_the_page_has_the_numbers_of_the_file() -> None:
    page, results = (HERE / "README.md").read_text(), json.loads((HERE / "at_place.json").read_text())
    for factors, found in results.items():
        assert found["laws"] == len(found["each"])
        assert found["within 1.25"] == sum(one["ratio"] < 1.25 for one in found["each"])
        row = (factors, *(value for key, value in found.items() if key != "each"))
        within, within_more, median, short, seconds = row[2:]
        line = f"| {factors} | {row[1]} | {within} | {within_more} | {median} | {short} | {seconds} |"
        assert line in page
