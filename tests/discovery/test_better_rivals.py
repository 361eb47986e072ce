"""A finding gives way to what predicts clearly better in its place, though the likelihood has both at another price."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from experiments.blind.generate import make
from gpmodel.api.discover import discover
from gpmodel.api.table import read_table
from gpmodel.discovery.search import Search


@pytest.mark.long
def test_a_drift_that_bends_in_every_direction_is_not_left_along_one(tmp_path: Path) -> None:
    """The line along one axis and the rest of the drift were chosen together; the rest alone says less than a walk."""
    make("drift", 61, tmp_path)
    table = read_table(tmp_path / "table.csv", tmp_path / "robot.urdf", in_order=True)
    answer = discover(tmp_path / "robot.urdf", table, search=Search(runs=0))
    assert [finding.name for finding in answer.findings] == ["drift of the set-up, bent"]
    outdone = {c.name: c.why for r in answer.record.rounds for c in r.candidates if not c.accepted}
    assert "another effect in its place predicts better" in outdone["drift of the set-up, Ty"]


@pytest.mark.long
def test_a_law_that_predicts_better_than_a_named_curve_takes_its_place(tmp_path: Path) -> None:
    make("gantry_sag", 61, tmp_path)
    answer = discover(tmp_path / "robot.urdf", tmp_path / "table.csv")
    assert "square(J2) on J2.moving Tx" in {finding.name for finding in answer.findings}
