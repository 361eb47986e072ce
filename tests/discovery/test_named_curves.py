"""Test that a formula replaces a smooth term only if the evidence of the selection stays nearly as high."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from experiments.blind.generate import make
from experiments.random_laws.judge import write
from experiments.random_laws.robot import make as with_law
from gpmodel.api.discover import discover
from gpmodel.api.table import read_table
from gpmodel.discovery.search import Search


@pytest.mark.long
def test_two_errors_of_one_guideway_keep_their_names(tmp_path: Path) -> None:
    """A law for either alone predicts as well; with both laws the choice falls back on surfaces of other joints."""
    make("scara_straightness", 60, tmp_path)
    answer = discover(tmp_path / "robot.urdf", tmp_path / "table.csv", search=Search(runs=0))
    assert {finding.name for finding in answer.findings} == {"straightness EXZ, J3", "pitch or yaw EBZ, J3"}


@pytest.mark.long
def test_one_law_in_the_place_of_two_curves_is_allowed_what_both_are(tmp_path: Path) -> None:
    """A bump of one input and a saturation of another at one place; their law is 4 nats less likely than two curves."""
    table, description, _ = write(with_law(0, 2, 8), tmp_path)
    (finding,) = discover(description, table, search=Search(runs=0)).findings
    assert sorted(finding.inputs) == ["J3", "torque_J4"]


@pytest.mark.long
def test_one_column_after_two_lags_is_one_lag_between_them(tmp_path: Path) -> None:
    """Lags of 24 and 80 min are offered, the room is followed after 40: no law of the two says it."""
    make("lag_forearm", 61, tmp_path)
    table = read_table(tmp_path / "table.csv", tmp_path / "robot.urdf", in_order=True)
    (finding,) = discover(tmp_path / "robot.urdf", table, search=Search(runs=0)).findings
    (column,) = finding.inputs
    assert column.startswith("lag_temperature_")
    assert float(column.rsplit("_", 1)[1].replace("p", ".")) == pytest.approx(40.0, rel=0.05)
