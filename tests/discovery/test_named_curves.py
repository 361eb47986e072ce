"""A curve that has a name gives way to a short law only where the whole choice is as likely with it."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from experiments.blind.generate import make
from gpmodel.api.discover import discover
from gpmodel.discovery.search import Search


@pytest.mark.long
def test_two_errors_of_one_guideway_keep_their_names(tmp_path: Path) -> None:
    """A law for either alone predicts as well; with both laws the choice falls back on surfaces of other joints."""
    make("scara_straightness", 60, tmp_path)
    answer = discover(tmp_path / "robot.urdf", tmp_path / "table.csv", search=Search(runs=0))
    assert {finding.name for finding in answer.findings} == {"straightness EXZ, J3", "pitch or yaw EBZ, J3"}
