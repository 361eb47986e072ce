"""Places and chances in words."""

import pytest

from gpmodel import wording
from gpmodel.report.words import place


@pytest.mark.parametrize(
    ("slot", "axis", "said"),
    [
        ("J5.moving", "Ry", "turn about y of the frame just after the motion of J5"),
        ("J2.fixed", "Tx", "shift along x of the frame just before the motion of J2"),
        ("base", "Rz", "turn about z of the frame at the base, before the first joint"),
        ("tool", "Tz", "shift along z of the frame at the flange, after the last joint"),
        ("instrument", "Tx", "shift along x of the frame of the instrument's readings, before they are registered"),
        ("J2.moving, J3.moving", "Rz", ""),
    ],
)
def test_places_are_said_in_words(slot: str, axis: str, said: str) -> None:
    assert place(slot, axis) == said


@pytest.mark.parametrize(
    ("probability", "shuffles", "said"),
    [
        (1e-88, 8, "< 0.000001 by extrapolation from 8 shuffles"),
        (0.02, 199, "0.02 from 199 shuffles"),
        (0.02, None, "0.02"),
        (None, 8, "–"),
    ],
)
def test_a_chance_says_what_it_rests_on(probability: float | None, shuffles: int | None, said: str) -> None:
    assert wording.chance(probability, shuffles) == said
