"""The experiment on coverage: what is measured twice is counted once, and nothing is found where nothing is."""

import numpy as np
import pytest

from experiments.coverage.__main__ import counted
from experiments.coverage.asked import asked
from experiments.coverage.cases import DECLARED, FAMILIES
from experiments.coverage.fleets import fleet_asked
from experiments.coverage.measure import found, known
from experiments.coverage.printed import covered
from gpmodel.discovery.search import Search


@pytest.mark.long
def test_poses_measured_three_times_are_covered_as_poses_measured_once() -> None:
    rows = [known(FAMILIES["known"][f"ratio {how}"], 1) for how in ("single", "jitter")]
    assert all(row["within"] > 0.8 for row in rows)
    assert all(np.std([*row["geometry"], *row["effect"]]) < 1.7 for row in rows)


@pytest.mark.long
def test_an_innocent_robot_keeps_its_standard_model() -> None:
    row = {"case": "null_ur", "seed": 0, **found(FAMILIES["independent"]["null_ur"], 0, Search(runs=0))}
    assert row["found"] == row["unconfirmed"] == []
    assert not row["worse"]
    assert counted([row])["false additions"] == {"count": 0, "robots": []}


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "families"),
    [
        ("gantry_screws", ["screw pitch", "screw pitch", "cyclic error"]),
        ("scara_straightness", ["pitch or yaw EBZ"]),
    ],
)
def test_linear_axes_are_told_apart_from_the_instrument_and_from_the_tool(case: str, families: list[str]) -> None:
    """Two pitches are no scale of the instrument beside a third axis that makes up for it.

    Of a sliding axis whose tool point is along it the turn hardly shows: beside what its description says of it the
    pitch is named, and what it leaves of the straightness, within the noise, is not.
    """
    row = found(FAMILIES["linear"][case], 20, Search(runs=0))
    assert sorted(name.split(",")[0].split(" @")[0] for name in row["found"]) == sorted(families)
    assert row["false"] == 0
    assert row["fresh_mm"] < 0.6 * row["standard_mm"]


def test_every_known_robot_says_what_its_effect_is_called() -> None:
    assert set(DECLARED) == set(FAMILIES["known"])


@pytest.mark.long
def test_a_machine_is_asked_for_everything_printed_of_it() -> None:
    row = asked(1)
    assert set(row["z"]) == {"effect", "geometry", "place", "turn", "tool"}
    assert 0.8 < row["predicted"] <= 1.0
    assert 0.8 < row["compensated"] <= 1.0
    assert np.std([z for kind in row["z"].values() for z in kind]) < 1.7
    assert row["said"]["rms"] < row["said"]["within_95"] < row["said"]["largest"]
    assert covered([row])["machines"] == 1


@pytest.mark.long
def test_a_fleet_is_asked_against_the_type_it_was_drawn_from() -> None:
    row = fleet_asked(0)
    assert row["size"] == 5
    assert len(row["mean"]) == len(row["spread"]) > 5
    assert np.mean(row["spread"]) > 0.7
