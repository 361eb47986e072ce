"""Test a small case of the experiment on instruments, and the numbers of its page."""

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.instruments import run
from experiments.instruments.judge import bound, judge, tool_points
from experiments.instruments.measuring import KINDS, session
from experiments.instruments.robots import machine

HERE = Path(run.__file__).parent


@pytest.mark.first(2)
@pytest.mark.parametrize("kind", [name for name in KINDS if "camera" not in name])
def test_exact_readings_are_those_of_the_robot_as_it_is(kind: str) -> None:
    robots = machine(0, True, 2 if kind == "two arms" else 1)
    made = session(kind, robots, 12, np.random.default_rng(1))
    first, last, tools = 0, np.empty((12, 4, 4)), np.empty((12, 3))
    for k, robot in enumerate(robots):
        rows, n = made.arm == k, len(robot.arm.rows)
        last[rows] = robot.last(made.q[rows][:, first : first + n])
        tools[rows], first = robot.tool, first + n
    off = made.read(last, tools, made.own) - made.noisy
    assert 0.3 < np.sqrt(np.mean(off**2)) < 2.0


@pytest.mark.long
def test_a_probe_names_what_is_wrong_and_comes_near_the_bound() -> None:
    row = judge("planes and spheres", 0, True)
    assert row["named"]
    assert row["false"] == 0
    assert row["ratio"] < 2.0
    assert row["wrong_found"] == row["wrong"] == 1


def test_the_bound_falls_with_the_root_of_the_poses() -> None:
    robots, rng = machine(1, False), np.random.default_rng(0)
    fresh = session("tracker", robots, 50, rng).q
    least = [bound(robots, session("tracker", robots, n, rng), fresh, np.zeros(50, int)) for n in (60, 240)]
    assert 1.5 < least[0] / least[1] < 2.6
    assert tool_points(robots, session("tracker", robots, 3, rng), fresh, np.zeros(50, int)).shape == (50, 3)


def test_the_page_says_what_was_measured(tmp_path: Path) -> None:
    results = json.loads((HERE / "results.json").read_text(encoding="utf-8"))
    assert run.summary(results["machines"]) == results["summary"]
    page = (HERE / "README.md").read_text(encoding="utf-8")
    for line in run.cells(results["summary"]):
        assert "| " + " | ".join("" if cell is None else str(cell) for cell in line) + " |" in page
