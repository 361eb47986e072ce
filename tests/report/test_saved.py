"""report.json: what is written comes back equal; what is no report is refused with its place."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_runs import REPORTS, discovered

from gpmodel.errors import InputError
from gpmodel.report.saved import as_dict, from_json, read_report, to_json

CONTRACT = {
    "": {"schema", "command", "versions", "seed", "data", "mechanism", "ladder", "effects", "histogram",
         "noise_floor_mm", "verdict", "seconds"},
    "data": {"file", "sha256", "poses", "train", "heldout", "outliers"},
    "mechanism": {"name", "joints"},
    "ladder": {"step", "train", "heldout", "rank", "dropped", "effect"},
    "effects": {"name", "slot", "axis", "basis", "inputs", "value", "stderr", "unit", "unique_share", "found_by",
                "catalogue", "rivals", "causes"},
    "histogram": {"inputs", "linear", "tree", "shuffled", "significant"},
}  # fmt: skip
GONE = {"held_out_gain", "simplified", "null_gain", "correlation_partners", "partners"}


@pytest.mark.parametrize("case", REPORTS)
def test_what_is_written_comes_back_equal(case: str) -> None:
    report = REPORTS[case]()
    assert from_json(to_json(report)) == report


@pytest.mark.parametrize("case", REPORTS)
def test_every_kind_has_the_keys_of_the_contract_and_none_that_died(case: str) -> None:
    content = json.loads(to_json(REPORTS[case]()))
    for place, keys in CONTRACT.items():
        part = content[place] if place else content
        for record in part if isinstance(part, list) else [part]:
            assert set(record) >= keys, place
    assert not re.search("|".join(f'"{key}"' for key in GONE), json.dumps(content))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ladder": [{"step": 1}]}, "$.ladder[0].step"),
        ({"noise_floor_mm": -1.0}, "$.noise_floor_mm"),
        ({"effects": [{"name": "x", "p_value": 1.5}]}, "$.effects[0].p_value"),
        ({"effects": [{"slot": "J1.moving"}]}, "missing required field `name`"),
        ({"data": {"poses": -3}}, "$.data.poses"),
        ({"kind": "guessed"}, "$.kind"),
        ({"schema": 7}, "schema 7; this version reads 3; make it again: gpmodel discover measured.csv"),
        ({"ladder": None}, "has no 'ladder'"),
    ],
)
def test_a_wrong_value_is_refused_by_its_place(change: dict[str, Any], said: str) -> None:
    text = json.dumps(as_dict(discovered()) | change)
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        from_json(text, "here.json")
    assert str(refused.value).startswith("here.json: ")
    assert "\n" not in str(refused.value)


@pytest.mark.long
@given(st.one_of(st.text(max_size=40), st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps)))
def test_text_that_is_no_report_is_one_line(text: str) -> None:
    with pytest.raises(InputError) as refused:
        from_json(text)
    assert "expected the JSON that discover or calibrate wrote" in str(refused.value)


def test_unknown_keys_are_passed_over() -> None:
    report = discovered()
    assert from_json(json.dumps(as_dict(report) | {"comment": "mine"})) == report


def test_a_folder_is_read_and_one_without_a_report_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        read_report(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"has no report\.json"):
        read_report(tmp_path)
    (tmp_path / "report.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be read"):
        read_report(tmp_path)
    (tmp_path / "report.json").write_text(to_json(discovered()), encoding="utf-8")
    assert read_report(tmp_path) == discovered()


def test_every_representation_is_counted_and_older_files_name_their_command() -> None:
    report = discovered()
    first = replace(report.histograms[0], counts={"random": (1,) * len(report.histograms[0].inputs)})
    content = json.loads(to_json(replace(report, histograms=(first,))))
    assert content["histograms"][0]["counts"]["random"] == list(first.counts["random"])
    assert content["histogram"]["linear"] == [0] * len(first.inputs)
    with pytest.raises(InputError, match=r"schema 1; this version reads 3; make it again: gpmodel discover t.csv"):
        from_json(json.dumps(content | {"schema": 1, "command": "gpmodel discover t.csv"}))
