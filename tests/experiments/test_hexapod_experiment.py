"""Test hexapods with a bad screw: the leg is named, a sound machine gets no finding."""

from pathlib import Path

import numpy as np
import pytest

from experiments.hexapod import run
from experiments.hexapod.simulator import STROKE, readings, table

COMMITTED = Path(run.__file__).parent / "results.json"


def test_tables_repeat_and_stay_within_the_stroke() -> None:
    text, machine = table(5)
    assert (text, machine.leg) == (table(5)[0], table(5)[1].leg)
    lengths = np.array([[float(v) for v in row.split(",")[:6]] for row in text.splitlines()[1:]])
    assert lengths.shape == (120, 6)
    assert 1e3 * STROKE[0] < lengths.min() < lengths.max() < 1e3 * STROKE[1]
    assert readings.__module__.startswith("experiments")


@pytest.mark.slow
def test_the_leg_with_the_bad_screw_is_named_and_its_error_removed() -> None:
    machine = run.one_machine(1, True)
    assert run.right(machine)
    steps = list(machine["heldout_mm"].values())
    assert steps[-1] < 0.6 * steps[1]


@pytest.mark.slow
def test_a_machine_with_good_screws_is_left_alone() -> None:
    assert run.one_machine(1, False)["found"] == []
