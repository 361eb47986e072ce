"""report.json: what the contract promises, in millimetres, under the table's own names."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from loop_cases import QUICK, found, quick, rms, robot

from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.files import to_json
from gpmodel.model.error_model import prepare
from gpmodel.report.content import build, versions

KEYS = {
    "schema", "command", "versions", "seed", "data", "mechanism", "ladder", "effects", "histogram", "noise_floor_mm",
    "verdict", "seconds",
}  # fmt: skip
EFFECT = {
    "name", "slot", "axis", "basis", "inputs", "value", "stderr", "unit", "unique_share", "found_by", "catalogue",
    "rivals",
}  # fmt: skip


@cache
def report(case: str) -> dict[str, Any]:
    return build(found(case, 0), "gpmodel discover", 0, None)


@pytest.mark.parametrize("case", ["nothing", "gear", "windup"])
def test_it_has_what_the_contract_promises_and_is_plain_json(case: str) -> None:
    made = report(case)
    assert set(made) >= KEYS
    again = json.loads(to_json(made))
    assert again["ladder"] == made["ladder"]
    assert made["data"]["train"] + made["data"]["heldout"] == made["data"]["poses"] == 80
    for effect in made["effects"]:
        assert set(effect) >= EFFECT
    for rung in made["ladder"]:
        for side in ("train", "heldout"):
            assert set(rung[side]) == {"mean_mm", "rms_mm", "max_mm"}
    assert [r["step"] for r in made["ladder"][:2]] == ["registration", "standard"]
    histogram = made["histogram"]
    assert {len(histogram[k]) for k in ("inputs", "linear", "tree", "shuffled")} == {len(histogram["inputs"])}
    assert set(histogram["significant"]) <= set(histogram["inputs"])


def test_figures_are_those_of_the_steps_in_millimetres() -> None:
    for step, rung in zip(found("gear", 0).steps, report("gear")["ladder"], strict=True):
        assert rung["heldout"]["rms_mm"] == pytest.approx(1e3 * rms(step.heldout_error))
        assert rung["train"]["max_mm"] == pytest.approx(1e3 * step.train_error.max())
        assert rung["dropped"] == list(step.calibration.dropped)


def test_an_effect_carries_its_size_its_deviation_and_its_name() -> None:
    (effect,) = report("gear")["effects"]
    truth = robot("gear", 0)[0].theta[-2:]
    assert effect["name"] == "gear error, 2 per turn, J4"
    assert (effect["slot"], effect["axis"], effect["inputs"]) == ("J4.moving", "Rx", ["J4"])
    assert (effect["unit"], effect["catalogue"]) == ("rad", "gear_harmonic")
    assert abs(effect["value"] - np.hypot(*truth)) < 3.5 * effect["stderr"]
    assert effect["stderr"] < 0.2 * effect["value"]
    assert 0 < effect["unique_share"] <= 1
    assert report("gear")["ladder"][2]["effect"] == 0


def test_a_finding_that_matches_no_family_says_so() -> None:
    first = report("windup")["effects"][0]
    assert first["catalogue"] is None
    assert first["explanation"] == "matches no named effect"
    assert first["found_by"] == "evolved"


def test_the_verdict_says_what_was_added_or_that_nothing_was() -> None:
    assert "nothing was added" in report("nothing")["verdict"]
    assert report("nothing")["effects"] == []
    assert "gear error, 2 per turn, J4" in report("gear")["verdict"]
    standard = report("gear")["ladder"][1]["heldout"]["rms_mm"]
    assert f"{standard:.3f} mm RMS on held-out poses" in report("gear")["verdict"]


def test_the_same_run_gives_the_same_report() -> None:
    one, other = (build(quick(), "gpmodel discover", 0, None) for _ in range(2))
    assert to_json(one) == to_json(other)


def test_the_number_of_workers_is_not_in_the_report() -> None:
    truth, train, heldout = robot("gear", 0)
    two = discover(truth.model.mechanism, truth.poses, train, heldout, search=replace(QUICK, workers=2))
    texts = [to_json(build(replace(d, seconds=0.0), "", 0, None)) for d in (quick(), two)]
    assert texts[0] == texts[1]


def test_outliers_are_rows_of_the_file_and_names_are_the_tables() -> None:
    truth, train, heldout = robot("nothing", 0)
    position = truth.poses.dataset.position.copy()
    position[5] += 3e-3
    columns = tuple(f"axis_{i}" for i in range(1, 7))
    data = replace(truth.poses.dataset, position=position, row=truth.poses.dataset.row + 100, columns=columns)
    answer = discover(
        truth.model.mechanism, prepare(truth.model.mechanism, data), train, heldout, search=Search(max_effects=0)
    )
    made = build(answer, "", 0, None)
    assert made["data"]["outliers"] == [106]
    assert made["mechanism"]["joints"] == list(columns)
    assert {p["name"].split()[0] for p in made["parameters"]} == set(columns)


def test_the_noise_floor_is_of_repeats_before_the_instruments_figure() -> None:
    truth, train, heldout = robot("nothing", 0)
    arm = truth.model.mechanism
    bare = discover(arm, truth.poses, train, heldout, search=Search(max_effects=0))
    assert build(bare, "", 0, 5e-5)["noise_floor_mm"] == 0.05
    assert report("nothing")["noise_floor_mm"] is None


def test_dropped_parameters_have_no_deviation() -> None:
    for parameter in report("nothing")["parameters"]:
        assert parameter["kept"] == (parameter["stderr"] is not None)
        assert parameter["kept"] or parameter["value"] == 0.0


def test_versions_name_what_the_numbers_depend_on() -> None:
    assert {"python", "gpmodel", "numpy", "scipy"} <= set(versions())


def test_the_shape_of_a_finding_follows_its_data() -> None:
    (shape,) = report("gear")["plots"]["shapes"]
    assert (shape["x_name"], shape["x_unit"], shape["y_unit"]) == ("J4", "deg", "µrad")
    curve = np.interp(shape["x"], shape["curve_x"], shape["curve_y"])
    assert np.corrcoef(curve, shape["partial"])[0, 1] > 0.9
