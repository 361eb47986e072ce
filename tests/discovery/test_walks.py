"""Test that a drift of the tracker is named as a drift and not as a step of the set-up."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from experiments.blind.generate import make
from gpmodel.api.discover import discover
from gpmodel.api.table import read_table
from gpmodel.discovery.search import Search


@pytest.mark.long
@pytest.mark.parametrize("seed", [61, 62])
def test_what_a_walk_of_few_waves_leaves_is_no_step(seed: int, tmp_path: Path) -> None:
    make("tracker_walk_seven", seed, tmp_path)
    answer = discover(tmp_path / "robot.urdf", tmp_path / "table.csv", search=Search(runs=0))
    assert {finding.catalogue for finding in answer.findings} == {"instrument_walk"}


@pytest.mark.long
def test_a_drift_that_bends_in_every_direction_is_a_drift_and_nothing_else(tmp_path: Path) -> None:
    make("drift", 61, tmp_path)
    table = read_table(tmp_path / "table.csv", tmp_path / "robot.urdf", in_order=True)
    answer = discover(tmp_path / "robot.urdf", table, search=Search(runs=0))
    assert {finding.catalogue for finding in answer.findings} == {"drift"}
