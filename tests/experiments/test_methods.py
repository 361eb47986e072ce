"""Test the interface of foreign methods: answers, scores and leaderboard."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.bench import fixed, run
from experiments.bench.judge import judge
from experiments.bench.robots import ROBOTS
from experiments.bench.run import changed, counted, worse
from experiments.blind.arms import ARMS
from experiments.blind.files import urdf
from experiments.methods.makers import makers_in, table
from experiments.methods.plug import Answer, asked, geometry
from experiments.methods.regressions import denavit_hartenberg, of_the_rest
from experiments.methods.rows import append, summary
from experiments.random_laws.judge import write
from experiments.random_laws.robot import make


def row(index, ratio, **more):
    return {"method": "m", "seed": 0, "factors": 1, "index": index, "ratio": ratio, "seconds": 1.0, **more}


def test_counts_over_robots():
    counts = summary([row(0, 1.1, explained=0.99), row(1, 1.4, explained=0.97), row(2, 9.0, explained=0.2)])
    assert (counts["within 1.25"], counts["within 1.5"], counts["explained to 95 %"]) == (1, 2, 2)
    assert summary([{**row(0, 1.0), "failed": "no"}]) == {"robots": 1, "failed": 1}


FILES = (Path("table.csv"), Path("robot.urdf"), Path("poses.csv"))


def test_positions_alone_are_an_answer_and_are_scored_against_the_true_ones():
    true = np.zeros((5, 3))
    scored, answer = asked(lambda *files: true + np.array([0.0, 3e-4, 4e-4]), FILES, true, (1.0, 0.25))
    assert (scored["error_mm"], scored["ratio"]) == (pytest.approx(0.5), pytest.approx(2.0))
    assert scored["explained"] == pytest.approx(0.75 / 0.9375)
    assert isinstance(answer, Answer)
    assert answer.findings is None
    assert "explained" not in asked(lambda *files: true, FILES, true, (0.25, 0.25))[0]


@pytest.mark.parametrize("wrong", [np.zeros((4, 3)), np.full((5, 3), np.nan)])
def test_positions_of_other_poses_or_none_are_said_and_not_scored(wrong):
    scored, answer = asked(lambda *files: wrong, FILES, np.zeros((5, 3)), (1.0, 0.25))
    assert answer is None
    assert set(scored) == {"failed"}
    assert "expected (5, 3), all finite" in scored["failed"]


def test_rows_of_a_description_are_those_it_was_written_from(tmp_path):
    for name in ("irb_like", "scara", "seven_tilted"):
        arm = ARMS[name]
        (tmp_path / name).write_text(urdf(arm))
        rows, slides = denavit_hartenberg(tmp_path / name)
        alpha, a, theta, d = rows.T
        np.testing.assert_allclose(np.column_stack([a, d]), 1e3 * arm.rows[:, 1:3], atol=1e-6)
        np.testing.assert_allclose(np.exp(1j * alpha), np.exp(1j * arm.rows[:, 0]), atol=1e-9)
        np.testing.assert_allclose(np.exp(1j * theta), np.exp(1j * arm.rows[:, 3]), atol=1e-9)
        assert {k + 1 for k, s in enumerate(slides) if s} == arm.prismatic


@pytest.mark.long
def test_a_regression_is_of_what_the_standard_model_leaves(tmp_path):
    files = write(make(0, 1, 4), tmp_path)

    def constant(columns, response):
        assert np.abs(columns).max() == pytest.approx(1.0)
        assert abs(response.mean()) < response.std()
        return lambda others: np.full(len(others), 2.0)

    moved = of_the_rest(constant, *files) - geometry(*files)
    np.testing.assert_allclose(moved, 2e-3, atol=1e-9)


def test_findings_are_counted_by_their_makers_in_rows_and_reports(tmp_path):
    rows, report = tmp_path / "rows.jsonl", tmp_path / "report.json"
    found = [{"found_by": maker} for maker in ("smooth term", "formula", "formula of generation 2", "sequence")]
    append(row(0, 1.0, found=found), rows)
    append(row(1, 1.0, found=[{"name": "without a maker"}]), rows)
    append(row(2, 1.0), rows)
    effects = [{"found_by": "catalogue", "kept": True}, {"found_by": "tree", "kept": False}]
    report.write_text(json.dumps({"effects": effects}))
    lines = table([*makers_in(rows), *makers_in(report)]).splitlines()
    cells = {line.split(" | ")[0].strip("| "): line.strip("| ").split(" | ")[1:] for line in lines[2:]}
    assert cells["m: 1"] == ["5", "", *["1 (20%)"] * 3, "", "1 (20%)", "1 (20%)"]
    assert cells["reports"][:2] == ["1", "1 (100%)"]
    assert cells["total"][0] == "6"


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
