"""The bench: its table of robots, its comparison of two versions, one robot of each kind from end to end."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments.bench import fixed, run
from experiments.bench.judge import judge
from experiments.bench.robots import ROBOTS
from experiments.bench.run import changed, counted, worse

ROW = {
    "robot": "r",
    "kind": "effects",
    "ratio": 1.0,
    "named": 2,
    "effects": 2,
    "false": 0,
    "found": ["a"],
    "seconds": 3.0,
}


def test_the_table_has_every_kind_and_a_short_list_of_most() -> None:
    kinds = [robot.kind for robot in ROBOTS.values()]
    assert [kinds.count(kind) for kind in ("effects", "formula", "none")] == [40, 20, 10]
    quick = [robot for robot in ROBOTS.values() if robot.quick]
    assert len(quick) == 12
    assert {robot.kind for robot in quick} == set(kinds)


@pytest.mark.parametrize(
    ("other", "said", "is_worse"),
    [
        ({}, "", False),
        ({"ratio": 1.019, "seconds": 9.0}, "", False),
        ({"ratio": 1.03}, "WORSE", True),
        ({"ratio": 0.97}, "better", False),
        ({"found": ["b"]}, "other", False),
        ({"found": ["a", "b"], "false": 1}, "WORSE", True),
        ({"found": [], "named": 1}, "WORSE", True),
    ],
)
def test_two_versions_are_compared_robot_by_robot(other: dict[str, object], said: str, is_worse: bool) -> None:
    now = ROW | other
    assert worse(ROW, now) == is_worse
    assert (said in changed(ROW, now)) if said else changed(ROW, now) == ""


def test_a_robot_that_fails_is_worse_and_counted() -> None:
    failed = {"robot": "s", "kind": "effects", "failed": "RuntimeError: no", "seconds": 1.0}
    assert worse(ROW, failed)
    assert not worse(failed, ROW)
    assert "robots 2, failed 1, median ratio 1.000" in counted([ROW, failed])


def test_rows_are_written_in_the_order_of_the_table_and_read_again(tmp_path: Path) -> None:
    names = list(ROBOTS)[:2]
    rows = {name: ROW | {"robot": name} for name in reversed(names)}
    run.write(rows, tmp_path / "rows.json")
    assert list(run.read(tmp_path / "rows.json")) == names
    assert run.read(tmp_path / "rows.json") == rows


def test_the_committed_results_are_those_of_robots_of_the_table() -> None:
    assert set(run.read(run.RESULTS)) <= set(ROBOTS)


@pytest.mark.long
@pytest.mark.parametrize("name", ["two_move_30", "law_2_1_7"])
def test_a_robot_is_judged_from_end_to_end(name: str, tmp_path: Path) -> None:
    row = judge(replace(ROBOTS[name], evolved=False), tmp_path / name)
    assert row["ratio"] < 1.25
    assert (row["named"], row["false"]) == (row["effects"], 0)


@pytest.mark.parametrize(
    ("now", "told"),
    [
        ({"a": [1.0, {"b": "x"}], "n": None}, []),
        ({"a": [1.0 + 1e-10, {"b": "x"}], "n": None}, []),
        ({"a": [1.0 + 1e-8, {"b": "x"}], "n": None}, ["a[0]"]),
        ({"a": [1.0, {"b": "y"}], "n": 0.0}, ["a[1].b", "n"]),
        ({"a": [1.0], "n": None}, ["a"]),
        ({"a": [1.0, {"b": "x"}]}, []),
    ],
)
def test_fixed_reports_differ_by_numbers_past_nine_digits_and_by_words(now: object, told: list[str]) -> None:
    before = {"a": [1.0, {"b": "x"}], "n": None}
    assert [line.split(":")[0] for line in fixed.differences(before, now)] == told


def test_times_and_versions_are_left_out_of_fixed_reports_at_any_depth() -> None:
    assert fixed.without({"a": [{"seconds": 2.0, "b": 1}], "versions": {"python": "3"}}) == {"a": [{"b": 1}]}
