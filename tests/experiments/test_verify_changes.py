"""Test that a check notices any kind of change, names the part and repairs the model."""

from functools import cache

import pytest

from experiments.verify.changes import Machine, machine, trial

AFTER_90 = 1.6
"""Error of a repaired model over one of 90 poses: 1.2 is promised, and both are of one session."""
known = cache(machine)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "type_", "seed"),
    [("backlash", "irb6400r", 0), ("thermal", "irb6400r", 0), ("gear", "irb6400r", 0), ("tool slipped", "scara", 0)],
)
def test_a_change_is_noticed_named_and_repaired(kind: str, type_: str, seed: int) -> None:
    own: Machine = known(type_, seed)
    row = trial(own, kind, 10.0, 0)
    assert row is not None
    assert row["noticed"] is not None
    assert row["noticed"] <= 10
    assert row["in_set"]
    assert row["rounds"][-1]["mm"] < AFTER_90 * row["anew_mm"]


@pytest.mark.long
def test_another_machine_is_none_that_changed() -> None:
    row = trial(known("irb6400r", 0), "another machine", 10.0, 0, known("irb6400r", 1))
    assert row is not None
    assert row["verdict"] == row["batch"] == "another machine"
