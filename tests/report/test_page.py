"""Test report.html and explore.html of small searches: offline, accessible, equal to the report."""

import dataclasses
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from instances import some
from report_runs import REPORTS, calibrated, discovered, quickly

from gpmodel import wording
from gpmodel.cli.results import report as report_command
from gpmodel.errors import InputError
from gpmodel.evidence.cross_validation import Confirmation
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.report import explore
from gpmodel.report.figures import drawn
from gpmodel.report.page import html, pictures
from gpmodel.report.saved import as_dict, from_json, read_report, to_json
from gpmodel.report.schema import ErrorsMm, ParameterRecord, Report
from gpmodel.report.schema_search import CandidateRecord, CauseRecord, EffectRecord, RoundRecord
from gpmodel.report.words import beforehand, input_tests, place

VOID = {"meta", "link", "img", "br"}


class Page(HTMLParser):
    """Tags with their attributes, the text of each, and whether every tag is closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {k: v or "" for k, v in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {k: v or "" for k, v in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script", "svg"} & set(self.open):
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]


@cache
def drawings(case: str) -> dict[str, str]:
    return drawn(pictures(REPORTS[case]()))


def page(report: Report) -> Page:
    """The page without its pictures."""
    return Page(html(report, {}))


@pytest.mark.long
@pytest.mark.parametrize("case", REPORTS)
def test_opens_offline_and_is_accessible(case: str) -> None:
    report = REPORTS[case]()
    text = html(report, drawings(case))
    made = Page(text)
    assert made.open == []
    assert not re.search(r"https?://(?!www\.w3\.org/)|@import|url\((?!#)", text)
    assert [link["href"] for link in made.all("link")] == ["data:,"]
    assert "default-src 'none'" in made.all("meta")[2]["content"]
    drawn = [a for _, a in made.tags if a.get("role") == "img"]
    assert len(drawn) == len(list(pictures(report)))
    assert all(len(a["aria-label"]) > 20 for a in drawn)
    assert all(th.get("scope") in ("col", "row", "colgroup") for th in made.all("th"))
    ids = [a["id"] for _, a in made.tags if "id" in a]
    assert len(ids) == len(set(ids))
    rows = {f"explore.html#row={row}" for row in report.plots.rows}
    inside = {a["href"] for a in made.all("a") if a["href"].startswith("#")}
    assert inside <= {f"#{i}" for i in ids}
    assert {a["href"] for a in made.all("a")} - inside <= {"explore.html", "poses.csv"} | rows
    assert len(made.all("h1")) == 1
    assert made.all("html") == [{"lang": "en"}]
    assert report.verdict in made.text


@pytest.mark.first(1)
@pytest.mark.parametrize("case", some(REPORTS, "gear", "calibrated", "evolved"))
def test_pictures_take_their_colours_from_the_page_and_share_no_ids(case: str) -> None:
    every = drawings(case)
    for name, svg in every.items():
        assert not re.search(r"#[0-9a-fA-F]{6}\b", svg), name
        assert all(i.startswith(f"{name}-") for i in re.findall(r' id="([^"]+)"', svg))


def test_the_first_screen_says_noise_floor_causes_and_whether_it_is_confirmed() -> None:
    report = discovered()
    (effect,) = report.effects
    causes = (CauseRecord((effect.name,), 0.6, own=True), CauseRecord(("something alike",), 0.4))
    head = page(dataclasses.replace(report, effects=(dataclasses.replace(effect, causes=causes),))).text
    head = head[: head.index("Error after each step")]
    assert "noise floor unknown measure repeats, or give --noise" in head
    assert "Confirmed on the held-out poses" in head
    assert "something alike" in head
    doubted = page(dataclasses.replace(report, confirmation=Confirmation(0.4, 0.35, 0.1, 20, False))).text
    assert "NOT CONFIRMED on the held-out poses: gain of 0.4 standard errors" in doubted
    known = page(quickly()).text
    assert f"noise floor {wording.millimetres(quickly().noise_floor_mm)} mm RMS from the stated noise" in known


def test_held_out_and_training_errors_stand_under_their_own_heading() -> None:
    report = discovered()
    rung = dataclasses.replace(
        report.ladder[1], heldout=ErrorsMm(0.111, 0.222, 0.333), train=ErrorsMm(0.444, 0.555, 0.666), rank=27
    )
    text = page(dataclasses.replace(report, ladder=(report.ladder[0], rung, *report.ladder[2:]))).text
    assert "step held out, mm train, mm" in text
    assert "standard model 0.111 0.222 0.333 0.444 0.555 0.666 27" in text


def test_without_held_out_poses_nothing_is_called_held_out() -> None:
    text = page(calibrated(0.0)).text
    assert "No poses were held out" in text
    assert "RMS training" in text
    assert "held out, mm" not in text


def test_an_effect_is_shown_with_all_that_is_known_of_it() -> None:
    report = discovered()
    (effect,) = report.effects
    text = page(report).text
    value = wording.measured(effect.value, effect.stderr, effect.unit)
    (trained,) = effect.ranges
    for said in (
        "The effect found", effect.name, f"{value.value} ± {value.deviation} {value.unit}",
        f"{effect.slot} {effect.axis}", place(effect.slot, effect.axis),
        f"unique share {wording.percent(effect.unique_share)}",
        f"range of J4 in training {trained.low:.4g}".replace("-", "−"), wording.length(effect.tool_rms_mm),
        wording.chance(effect.p_value, effect.shuffles, effect.shuffled), beforehand(report, effect),
    ):  # fmt: skip
        assert said in text


def test_nothing_found_says_so() -> None:
    text = page(discovered("nothing")).text
    assert "Nothing was added to the standard model." in text
    assert "Round 1: nothing added" in text
    assert "effects found" not in text


def test_the_histogram_says_which_of_its_tests_failed() -> None:
    counted = Histogram(
        ("J1", "J2", "J3"), {"linear": (4, 4, 0), "tree": (4, 3, 0)}, {"linear": (1, 0, 2)}, {}, {"linear": 8},
        {"linear": 8}, (0.002, 0.01, 1.0), (0.4, 0.003, 1.0), 0.05,
    )  # fmt: skip
    first, second = input_tests(counted)
    assert first.startswith(
        "J1 is not significant (fails the test of strength): 8 of 8 programs contain this input, 1 of 8"
    )
    assert second.startswith("J2 is significant: 7 of 8")
    assert "0.003 extrapolated from 8 permutations" in second
    report = dataclasses.replace(discovered(), histograms=(counted,))
    one = EffectRecord("a", inputs=("J2",), round=1)
    assert beforehand(report, one) == "indicated J2 beforehand"
    assert "did not indicate this effect" in beforehand(report, dataclasses.replace(one, inputs=("J1",)))
    assert beforehand(report, dataclasses.replace(one, round=None)) == ""


def test_a_histogram_without_shuffled_runs_says_why() -> None:
    counted = dataclasses.replace(discovered().histograms[0], shuffled_runs={})
    (said,) = input_tests(counted)
    assert "comparison with permuted residuals was skipped" in said


def test_record_parameters_and_tool_point_are_listed() -> None:
    report = discovered()
    text = page(report).text
    kept = sum(p.kept for p in report.parameters)
    assert f"{kept} parameters fitted, {len(report.dropped())} held at zero" in text
    tool = report.placement[0]
    assert tool.name == "tool x"
    assert f"tool x {wording.measured(tool.value, tool.stderr, tool.unit).value}" in text
    for known in (report.command, report.data.sha256, f"numpy {report.versions['numpy']}", "seed 0", "1.5 s"):
        assert known in text


def test_what_free_joints_absorb_is_named_and_counted() -> None:
    report = dataclasses.replace(discovered(), unobservable=tuple(f"effect {k} of the joint" for k in range(40)))
    assert "effect 29 of the joint; and 10 more." in page(report).text


@pytest.mark.long
def test_text_from_the_table_is_never_markup() -> None:
    evil = "<script>alert(1)</script>"
    report = discovered()
    data = dataclasses.replace(report.data, file=evil)
    effects = (dataclasses.replace(report.effects[0], name=evil),)
    changed = dataclasses.replace(report, data=data, effects=effects, verdict=evil)
    for text in (html(changed, {}), explore.html(changed), *drawn(pictures(changed)).values()):
        assert evil not in text
    assert evil in page(changed).text


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(Report) if f.name not in ("ladder", "schema")])
def test_any_part_may_be_missing(field: str) -> None:
    empty = getattr(Report(), field)
    report = dataclasses.replace(discovered(), **{field: empty})
    drawn = dict.fromkeys((p.name for p in pictures(report)), "<svg></svg>")
    assert wording.millimetres(report.ladder[-1].heldout.rms_mm) in Page(html(report, drawn)).text


def test_effects_and_candidates_may_be_bare() -> None:
    report = discovered()
    rounds = (dataclasses.replace(report.rounds[0], candidates=(CandidateRecord(),)), RoundRecord())
    bare = dataclasses.replace(
        report,
        effects=(EffectRecord("something"),),
        rounds=rounds,
        parameters=(ParameterRecord("length", 1e-3, unit="m"),),
    )
    text = page(bare).text
    assert "something" in text
    assert "length 1.00 – mm –" in text


@pytest.mark.long
def test_the_command_writes_every_file_from_the_saved_report(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text(to_json(discovered("nothing")), encoding="utf-8")
    result = CliRunner().invoke(report_command, [str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    written = {p.name for p in tmp_path.iterdir()}
    assert written == {"report.html", "report.json", "poses.csv", "explore.html", "figures"}
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == html(discovered("nothing"), drawings("nothing"))
    assert {p.stem for p in (tmp_path / "figures").glob("*.png")} == set(drawings("nothing"))


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
    for where, keys in CONTRACT.items():
        part = content[where] if where else content
        for record in part if isinstance(part, list) else [part]:
            assert set(record) >= keys, where
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
