"""The page of the gauge has the numbers of its files, and these hold what it promises."""

import json
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "experiments" / "gauge"
PAGE = (FOLDER / "README.md").read_text(encoding="utf-8")
LIMIT = 1.05
"""Largest ratio of the errors of plain predictions to those as measured where the instrument is sound."""


def rows(file: str) -> list[dict[str, Any]]:
    return list(json.loads((FOLDER / file).read_text(encoding="utf-8"))["each"])


def test_the_page_has_a_line_for_every_robot() -> None:
    columns = ("plain_mm", "registered_mm", "as_measured_mm", "difference_mm", "rigid_mm")
    for row in rows("results.json"):
        assert " | ".join([*row["case"], *(f"{row[name]:.3f}" for name in columns)]) in PAGE


def test_of_a_sound_instrument_both_predictions_are_alike() -> None:
    sound = [row for row in rows("results.json") if row["case"][2] in ("own frame", "tracker")]
    assert sound
    assert all(row["plain_mm"] <= LIMIT * row["as_measured_mm"] for row in sound)


@pytest.mark.parametrize("file", ["results.json", "told.json"])
def test_no_rigid_motion_is_left_in_the_difference(file: str) -> None:
    assert all(row["rigid_mm"] <= 0.02 * row["difference_mm"] + 1e-4 for row in rows(file))
