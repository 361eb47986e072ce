"""The experiment on coverage: what is measured twice is counted once, and nothing is found where nothing is."""

import numpy as np

from experiments.coverage.__main__ import counted
from experiments.coverage.cases import DECLARED, FAMILIES
from experiments.coverage.measure import found, known
from gpmodel.discovery.search import Search


def test_poses_measured_three_times_are_covered_as_poses_measured_once() -> None:
    rows = [known(FAMILIES["known"][f"ratio {how}"], 1) for how in ("single", "jitter")]
    assert all(row["within"] > 0.8 for row in rows)
    assert all(np.std([*row["geometry"], *row["effect"]]) < 1.7 for row in rows)


def test_an_innocent_robot_keeps_its_standard_model() -> None:
    row = {"case": "null_ur", "seed": 0, **found(FAMILIES["independent"]["null_ur"], 0, Search(runs=0))}
    assert row["found"] == row["unconfirmed"] == []
    assert not row["worse"]
    assert counted([row])["false additions"] == {"count": 0, "robots": []}


def test_every_known_robot_says_what_its_effect_is_called() -> None:
    assert set(DECLARED) == set(FAMILIES["known"])
