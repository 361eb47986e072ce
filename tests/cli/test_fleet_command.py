"""Test output, files and refusals of `gpmodel fleet` and `gpmodel calibrate --fleet`."""

import os
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from brief_results import brief
from cli_cases import one_line, run
from fleet_cases import BASE, JOINT, MECHANISM, NOISE, machines, written

import gpmodel as gp

SAID = ("fleet", "DIR", "--mechanism", MECHANISM, "--effect", BASE, "--effect", JOINT)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("fleet") / "tables", machines(3, 5, outlier=1))


@pytest.fixture(scope="module")
def result(tables: Path) -> tuple[str, Path]:
    out = tables.parent / "result"
    with brief():
        done = run("fleet", tables, *SAID[2:], "--out", out)
    assert done.exit_code == 0, done.stderr
    return done.stdout, out


@pytest.mark.long
def test_it_prints_the_worst_first_and_the_type(result: tuple[str, Path]) -> None:
    text = result[0]
    assert max(map(len, text.splitlines())) <= 80 + len(str(result[1]))
    machines_block = text[text.index("[[Machines") : text.index("[[Effects]]")]
    assert machines_block.index("R-02") < min(machines_block.index(f"R-0{k}") for k in (1, 3, 4, 5))
    assert "base compliance" in text[text.index("[[Effects]]") : text.index("[[Geometry]]")]
    assert "effects named: base_compliance, joint_compliance J2" in text


class Page(HTMLParser):
    """Tags opened and closed, pictures, and links out of the page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.outward: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.outward += [v for k, v in attrs if k in ("src", "href") and v and not v.startswith(("#", "data:"))]


@pytest.mark.long
def test_the_page_is_whole_and_opens_offline(result: tuple[str, Path]) -> None:
    text = (result[1] / "fleet.html").read_text()
    page = Page(text)
    assert page.tags.count("svg") == 10
    assert page.tags.count("tr") > 5 + 15
    assert sorted(page.outward) == [f"machines/R-0{k}/report.html" for k in range(1, 6)]
    assert all((result[1] / link).is_file() for link in page.outward)
    assert sorted(p.name for p in result[1].iterdir()) == ["figures", "fleet.html", "fleet.json", "machines"]


@pytest.mark.long
def test_every_machine_leaves_a_model_that_predicts(result: tuple[str, Path], tables: Path) -> None:
    model = gp.load_model(result[1] / "machines" / "R-02" / "model.json")
    assert np.median(model.misses(tables / "R-02.csv")) < 3e3 * NOISE
    kept = {e.name for e in model.saved.model.effects if not e.constant}
    assert kept == {"base compliance", "joint compliance, J2"}


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_names_of_machines_are_escaped(tmp_path: Path) -> None:
    folder = written(tmp_path / "tables", {f"<b>{k}": v for k, v in machines(3, 2).items()})
    (folder / "~$<b>R-01.xlsx").write_bytes(b"of Excel, while the table is open")
    done = run("fleet", folder, "--mechanism", MECHANISM, "--effect", "none", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / "out" / "fleet.html").read_text()
    assert "<b>R-01" not in text
    assert "&lt;b&gt;R-01" in text


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_a_further_machine_starts_from_it(result: tuple[str, Path], tables: Path, tmp_path: Path) -> None:
    done = run("calibrate", tables / "R-01.csv", "--mechanism", MECHANISM, "--fleet", result[1] / "fleet.json",
               "--out", tmp_path / "out")  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert "which replaces about" in " ".join(done.stdout.split())
    assert (tmp_path / "out" / "model.json").exists()


def empty(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def one_left(folder: Path) -> None:
    for path in sorted(folder.iterdir())[1:]:
        path.unlink()


def other_joints(folder: Path) -> None:
    path = folder / "R-03.csv"
    path.write_text(path.read_text().replace("J6 [deg]", "J9 [deg]"))


def same_serial(folder: Path) -> None:
    (folder / "fleet.toml").write_text('[serials]\n"R-01.csv" = "R-02"\n')


def same_table(folder: Path) -> None:
    (folder / "R-09.csv").write_bytes((folder / "R-01.csv").read_bytes())


def no_rows(folder: Path) -> None:
    (folder / "R-02.csv").write_text("J1 [deg]\n")


def few_rows(folder: Path) -> None:
    path = folder / "R-02.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:6]))


def no_file(folder: Path) -> None:
    os.mkfifo(folder / "R-04.csv")


def serial_with_a_quote(folder: Path) -> None:
    (folder / "R-03.csv").rename(folder / 'R"03.csv')


def wrong_toml(folder: Path) -> None:
    (folder / "fleet.toml").write_text('machine = "ur10"\n')


def missing_table(folder: Path) -> None:
    (folder / "fleet.toml").write_text('[serials]\n"R-77.csv" = "a"\n')


@pytest.mark.first(7)
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (empty, "has no tables"),
        (one_left, "expected at least 2 of one type"),
        (other_joints, "R-03.csv"),
        (same_serial, "R-01.csv and R-02.csv are both of machine 'R-02'"),
        (same_table, "machines 'R-01' and 'R-09' have the same table"),
        (no_rows, "R-02.csv"),
        (few_rows, "R-02.csv: 5 distinct poses give 15 measured values"),
        (no_file, "R-04.csv: is no file"),
        (serial_with_a_quote, "without quotes"),
        (wrong_toml, "'machine' is unknown; expected mechanism = NAME"),
        (missing_table, "'R-77.csv' is no table of the folder"),
    ],
)
def test_bad_folders_are_one_line_and_leave_nothing(spoil: Callable[[Path], None], said: str, tmp_path: Path) -> None:
    folder = written(tmp_path / "tables", machines(3, 3))
    spoil(folder)
    done = run("fleet", folder, *SAID[2:], "--out", tmp_path / "out")
    assert said in one_line(done, 2)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_other_bad_input_is_one_line(tables: Path, tmp_path: Path) -> None:
    assert "no such folder" in one_line(run("fleet", tmp_path / "nowhere", *SAID[2:]), 2)
    assert "--mechanism" in one_line(run("fleet", tables, "--effect", "none"), 2)
    assert "--effect" in one_line(run("fleet", tables, *SAID[2:4], "--effect", "nonsense"), 2)
    both = run("fleet", tables, *SAID[2:4], "--effect", "none", "--effect", "base_compliance")
    assert "--effect: none together with other effects" in one_line(both, 2)
    assert "--holdout" in one_line(run("fleet", tables, *SAID[2:4], "--holdout", "0"), 2)
    missing = run("calibrate", tables / "R-01.csv", *SAID[2:4], "--fleet", tmp_path / "fleet.json")
    assert "cannot be read" in one_line(missing, 2)
