"""Grading of findings as found, false and readable, and results that survive an interruption."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from experiments.blind.cases import CASES
from experiments.blind.grading import answers, deviations, false, grade, innocent, nodes, readable, worse
from experiments.blind.run import chosen, parse
from experiments.blind.tables import markdown, save, saved
from experiments.blind.ways import ROBOTS, WAYS, counted
from experiments.blind.ways import markdown as side_by_side


@pytest.mark.parametrize(
    ("wanted", "inputs", "right"),
    [
        ([["torque_J3"], ["J2", "J3"]], ["J3", "J2"], True),
        ([["torque_J3"], ["J2", "J3"]], ["J3"], False),
        ([["moment_base_?"]], ["moment_base_x"], True),
        ([["J5", "J[2-6]"]], ["J5"], False),
        ([["row"]], [], False),
    ],
)
def test_right_answers(wanted, inputs, right):
    assert answers(wanted, inputs) is right


def test_an_effect_on_a_distractor_is_a_false_addition():
    truth = [{"named": [["J4"]]}]
    assert innocent(["humidity"], truth)
    assert not innocent(["J4", "humidity"], truth)
    assert innocent(["J4"], [])


DRIFT = {
    "kind": "instrument_drift", "settings": {}, "amount": 1.0, "named": [["row"]], "called": ["*drift*"],
    "place": "instrument", "hidden": False,
}  # fmt: skip
WEAK = {
    "kind": "compliance", "settings": {"joint": 3}, "amount": 2e-6, "named": [["torque_J3"]], "called": [],
    "place": "robot", "hidden": False,
}  # fmt: skip


def finding(name="law", inputs=("J1",), slot="J1.moving", basis="sin(J1)", **more):
    return {"name": name, "inputs": list(inputs), "slot": slot, "basis": basis, "catalogue": None, **more}


@pytest.mark.parametrize(
    ("found", "truth", "wrong"),
    [
        (finding(inputs=["row"], slot="base"), [DRIFT], False),
        (finding(inputs=["row"], slot="J2.moving"), [DRIFT], True),
        (finding("drift of the tracker", ["t"], "instrument"), [DRIFT], False),
        (finding(inputs=["row"], slot="J2.moving"), [], True),
        (finding(inputs=["torque_J3"], slot="J3.moving"), [DRIFT, WEAK], False),
        (finding(inputs=["J3"], slot="J3.moving"), [WEAK], True),
    ],
)
def test_an_effect_of_the_instrument_at_the_robot_is_false(found, truth, wrong):
    assert false(found, truth) is wrong


@pytest.mark.parametrize(
    ("law", "count"),
    [
        ("sin(J1)", 2),
        ("sin(2*J1 + 0.3)", 2),
        ("(row - 44.41) / 25.9 / exp((row - 44.41) / 25.9)", 4),
        ("tanh(J2) * cos(J5) + J3", 7),
        ("max(0.35, torque_J2 / 182.0) and min(-0.35, torque_J2 / 182.0)", 6),
        ("2 / exp(time)", 4),
        ("curve of J2, 10 harmonics", 25),
    ],
)
def test_nodes_of_a_law(law, count):
    assert nodes(law) == count


def test_a_name_or_a_short_law_is_readable():
    long = "tanh(max(J2, J3)) * exp(J2) * cos(J3)"
    assert readable(finding())
    assert not readable(finding(basis=long))
    assert readable(finding(basis=long, catalogue="joint_compliance"))
    assert not readable(finding(inputs=["J1", "J2", "J3"], basis="J1 * J2 * J3"))


def test_deviations_need_the_right_joint_and_unit():
    truth = {"case": {"masses_off": 0.0}, "effects": [WEAK]}
    right = finding(
        "joint compliance, J3", ["torque_J3"], "J3.moving", "torque_J3",
        value=2.2e-6, stderr=1e-7, unit="rad/Nm", catalogue="joint_compliance",
    )  # fmt: skip
    assert deviations([right], truth) == pytest.approx([2.0])
    assert deviations([{**right, "slot": "J2.moving"}], truth) == []
    assert deviations([{**right, "unit": "m/N"}], truth) == []


@pytest.mark.parametrize(
    ("turns", "basis", "counts"), [(1, "sin(J3 +1.2)", 1), (2, "sin(J3 +1.2)", 0), (1, "sin(J3)", 0)]
)
def test_an_amplitude_is_compared_with_its_own_pair(turns, basis, counts):
    truth = {**WEAK, "kind": "harmonic", "settings": {"joint": 3, "per_turn": turns}, "named": [["J3"]]}
    pair = finding("eccentricity", ["J3"], "J3.moving", basis, value=1e-4, stderr=1e-5, unit="rad", catalogue="e")
    assert len(deviations([pair], {"case": {"masses_off": 0.0}, "effects": [truth]})) == counts


def test_every_effect_is_counted_by_itself_and_hidden_ones_are_not():
    truth = {"case": {"masses_off": 0.0}, "effects": [WEAK, {**DRIFT, "hidden": True}]}
    graded = grade([finding(inputs=["torque_J3"], unit="", value=0.0)], truth)
    assert (graded["effects"], graded["effects_named"], graded["named"], graded["false"]) == (1, 1, True, 0)


def test_worse_is_judged_pose_by_pose():
    standard = np.random.default_rng(0).normal(size=(400, 3))
    assert worse(1.05 * standard, standard)
    assert not worse(1.0001 * standard, standard)
    assert not worse(np.random.default_rng(1).normal(size=(400, 3)), standard)


def test_options_of_the_product_are_its_own(monkeypatch):
    monkeypatch.setattr("sys.argv", ["run", "--workers", "2", "--minutes", "1", "--", "--workers", "1", "--seed", "3"])
    settings, asked = parse()
    assert (settings.workers, settings.seeds) == (2, 1)
    assert asked.options == ("--minutes", "1", "--workers", "1", "--seed", "3")
    settings.family, settings.only, settings.set = "masses", "massless_ur,massless_ten,base", "aside"
    assert chosen(settings) == ["massless_ten"]


def test_results_are_read_back_and_tabled(tmp_path):
    row = {"case": "last_move_3", "seed": 0, "options": ""}
    row |= {f"{who}_{kind}_mm": 0.1 for who in ("geometric", "oracle") for kind in ("train", "clean", "noisy")}
    save({("last_move_3", 0): row}, "command", tmp_path / "r.json")
    assert saved(tmp_path / "r.json") == {("last_move_3", 0): row}
    assert saved(tmp_path / "none.json") == {}
    assert "| last_move_3 | open | 0 | 0.100 | 0.100 |" in (tmp_path / "r.md").read_text()
    assert "failed: it stopped" in markdown([{**row, "failed": "it stopped"}], "command")


def test_one_robot_looked_at_in_several_ways_is_one_line():
    row = {"case": "base", "seed": 3, "named": True, "effects": 1, "effects_named": 1, "false": 0, "found": ["base"]}
    row |= {"oracle_clean_mm": 0.1, "geometric_clean_mm": 0.2, "ratio_noisy": 1.02, "ratio_clean": 1.4, "seconds": 3.0}
    rows = [{**row, "way": "catalogue alone"}, {**row, "way": "programs alone", "false": 2, "ratio_noisy": 1.3}]
    counts = {way: counted([r for r in rows if r["way"] == way]) for way in WAYS}
    assert [c.get("within_goal") for c in counts.values()] == [1, 0, None]
    assert [c.get("within_goal_exact") for c in counts.values()] == [0, 0, None]
    counts.pop("both")
    assert "| base 3 | single | 1.020 (1.40), 1 of 1 | 1.300 (1.40), 1 of 1, 2 false |" in side_by_side(rows, counts)


def test_the_robots_of_the_ways_are_open_and_of_every_family_but_ranges():
    assert not any(CASES[name].aside for name in ROBOTS)
    assert {CASES[name].family for name in ROBOTS} == {case.family for case in CASES.values()} - {"range"}
