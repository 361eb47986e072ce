import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import report_cases
from click.testing import CliRunner

from gpmodel.cli.report import report as report_command
from gpmodel.files import to_json
from gpmodel.report.figures import pictures
from gpmodel.report.page import html, write_page
from gpmodel.report.saved import from_json
from gpmodel.report.schema import Report

CASES = {c.__name__: c for c in (report_cases.found, report_cases.nothing, report_cases.many, report_cases.sparse)}


def read(content: dict[str, Any]) -> Report:
    return from_json(to_json(content))


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

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="session")
def figures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A stand-in file for every picture any of the reports has."""
    path = tmp_path_factory.mktemp("figures") / "any.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n")
    return {p.name: path for case in CASES.values() for p in pictures(read(case()))}


@pytest.mark.parametrize("case", CASES)
def test_opens_offline_and_is_accessible(case: str, figures: dict[str, Path]) -> None:
    report = json.loads(to_json(CASES[case]()))
    text = html(read(report), figures)
    page = Page(text)
    assert page.open == []
    assert page.all("script") == []
    assert "url(" not in text
    assert "@import" not in text
    assert [link["href"] for link in page.all("link")] == ["data:,"]
    images = page.all("img")
    assert len(images) == len(list(pictures(read(report))))
    assert all(i["src"].startswith("data:image/png;base64,") and len(i["alt"]) > 20 for i in images)
    assert all(th.get("scope") in ("col", "row", "colgroup") for th in page.all("th"))
    ids = [a["id"] for _, a in page.tags if "id" in a]
    assert len(ids) == len(set(ids))
    assert {a["href"] for a in page.all("a")} <= {f"#{i}" for i in ids}
    assert len(page.all("h1")) == 1
    assert page.all("html") == [{"lang": "en"}]
    assert report["verdict"] in page.text


def test_held_out_and_training_errors_stand_under_their_own_heading(figures: dict[str, Path]) -> None:
    report = report_cases.found()
    rung = report["ladder"][1]
    rung["heldout"] = {"mean_mm": 0.111, "rms_mm": 0.222, "max_mm": 0.333}
    rung["train"] = {"mean_mm": 0.444, "rms_mm": 0.555, "max_mm": 0.666}
    text = Page(html(read(report), figures)).text
    assert "step held out, mm train, mm" in text
    assert "standard model 0.111 0.222 0.333 0.444 0.555 0.666 27" in text


def test_without_held_out_poses_nothing_is_called_held_out(figures: dict[str, Path]) -> None:
    text = Page(html(read(report_cases.sparse()), figures)).text
    assert "No poses were held out" in text
    assert "RMS training" in text
    assert "held out, mm" not in text


def test_an_effect_is_shown_with_all_that_is_known_of_it(figures: dict[str, Path]) -> None:
    text = Page(html(read(report_cases.found()), figures)).text
    for said in (
        "2 effects found", "gear error, 2 per turn, J4", "251.0 ± 4.2 µrad", "× sin(2·J4 + 0.412)", "J4.moving Rx",
        "evolved in round 1", "unique share 93 %", "gear error, 2 per turn, J6 0.071", "J4 Rx −0.42",
        "48.3 ± 2.1 nrad/(N·m)",
        "Two cycles a turn: oval gear or flexspline (Tuttle 1992).", "balancing spring, J2 0.034",
    ):  # fmt: skip
        assert said in text


def test_nothing_found_says_so(figures: dict[str, Path]) -> None:
    text = Page(html(read(report_cases.nothing()), figures)).text
    assert "Nothing was added to the standard model." in text
    assert "4 distinct best candidates" in text
    assert "Round 1: nothing added" in text
    assert "effects found" not in text


def test_reasons_parameters_and_record_are_listed(figures: dict[str, Path]) -> None:
    report = report_cases.found()
    text = Page(html(read(report), figures)).text
    assert "not added : chance of it on shuffled residuals 0.2, limit 0.01" in text
    assert "33 parameters kept, 3 dropped" in text
    assert "J1 Tz J2 Tz J6 Tz" in text
    assert "outliers, by row 12" in text
    for known in (report["command"], report["data"]["sha256"], "numpy 2.4.6", "seed 0", "41.3 s"):
        assert known in text


def test_no_rival_is_claimed_only_where_rivals_were_looked_for(figures: dict[str, Path]) -> None:
    report = report_cases.found()
    report["effects"][0]["rivals"], said = [], "No rival explains the same data."
    assert said in Page(html(read(report), figures)).text
    del report["effects"][0]["rivals"]
    assert said not in Page(html(read(report), figures)).text


def test_what_free_joints_absorb_is_named_and_counted(figures: dict[str, Path]) -> None:
    report = report_cases.found() | {"absorbed": [f"effect {k} of the joint" for k in range(40)]}
    text = Page(html(read(report), figures)).text
    assert "effect 29 of the joint; and 10 more." in text


def test_text_from_the_table_is_never_markup(figures: dict[str, Path]) -> None:
    report = report_cases.found()
    report["data"]["file"] = report["effects"][0]["name"] = report["verdict"] = "<script>alert(1)</script>"
    page = Page(html(read(report), figures))
    assert page.all("script") == []
    assert "<script>alert(1)</script>" in page.text


def test_the_page_draws_its_own_figures_where_none_are_given(tmp_path: Path) -> None:
    page = write_page(read(report_cases.sparse()), tmp_path)
    assert page == tmp_path / "report.html"
    assert (tmp_path / "figures" / "ladder.png").exists()
    assert len(Page(page.read_text(encoding="utf-8")).all("img")) == 1


def test_the_command_makes_page_and_figures_from_the_saved_report(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text(to_json(report_cases.nothing()), encoding="utf-8")
    result = CliRunner().invoke(report_command, [str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    files = {p.stem: p for p in (tmp_path / "figures").glob("*.png")}
    assert page == html(read(report_cases.nothing()), files)
    assert set(files) == {p.name for p in pictures(read(report_cases.nothing()))}
    assert f"{len(files)} figures" in result.output
