"""Test hostile text in every text of every file format with every command.

No code of it runs, nothing of it steers the terminal or forges a line, nothing ends in a traceback.
"""

import json
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from cli_cases import one_line, robot, run, table, write

from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import load_model
from gpmodel.api.results import write_numbers
from gpmodel.api.saved import load_result
from gpmodel.errors import InputError
from gpmodel.texts import SEAL, seal

ARM = (files("robots") / "data" / "irb6400r.toml").read_text(encoding="utf-8")
HEXAPOD = (files("joints") / "data" / "hexapod.toml").read_text(encoding="utf-8")
URDF = (
    '<robot name="ROBOT"><link name="a"/><link name="LINK"/><joint name="JOINT" type="revolute"><parent link="a"/>'
    '<child link="LINK"/><origin xyz="0.5 0 1" rpy="0 0.1 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>'
    "</robot>"
)
FORGED = "fit to calibrate with; no warnings"
HOSTILE = {
    "python": 'x"""\nopen("CANARY", "w")\n"""',
    "expression": "__import__('os').system('touch CANARY')",
    "c": '*/int system(const char*);__attribute__((constructor))static void p(void){system("touch CANARY");}/*',
    "shell": "$(touch CANARY)`touch CANARY`; touch CANARY",
    "html": '<script src="http://a"></script><img onerror=x>"\'&',
    "placeholder": "*@TERMS@/ @NOTE@ {0} %s ${a}",
    "terminal": "a\x1b[31mRED\x1b]0;title\x07\x9b2J\u202eb",
    "line": f"a\n{FORGED}\nb\r\nc\u2028d",
    "long": "a" * 5000,
}
SOURCE = ("python", "c", "placeholder")
"""Kinds of which every export is made from a table or a description."""
QUICK = ("python", "terminal")
"""Kinds of which the default suite uses only quickly read tables and descriptions."""

MODEL = Path("model.json")
KNOWN: dict[str, str] = {}
"""Cache of the files that `saved` writes."""
Case = tuple[str, Callable[[str, Path], list[list[object]]]]


def given_toml(text: str, key: str, folder: Path, source: str = ARM) -> Path:
    """A description in which a key, or the name of a table, is the text."""
    said = json.dumps(text, ensure_ascii=True)
    lines = source.splitlines()
    at = next((i for i, line in enumerate(lines) if line.split("=")[0].strip() == key), None)
    if at is None:
        lines.insert(0, f"{key} = {said}")
    else:
        lines[at] = f"{key} = {said}"
    path = folder / "arm.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def described(key: str, source: str) -> Callable[[str, Path], list[list[object]]]:
    def make(text: str, folder: Path) -> list[list[object]]:
        arm, data = given_toml(text, key, folder, source), write(table(40), folder / "t.csv")
        whole = [["calibrate", data, "--mechanism", arm, "--out", folder / "out"], ["export", folder / "out"]]
        return [["check", data, "--mechanism", arm], ["simulate", "--mechanism", arm, "--poses", 3], *whole]

    return make


def in_urdf(place: str) -> Callable[[str, Path], list[list[object]]]:
    def make(text: str, folder: Path) -> list[list[object]]:
        said = text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;").replace("\n", "&#10;")
        filled = URDF.replace(place, said)
        path = folder / "arm.urdf"
        path.write_text(filled, encoding="utf-8")
        return [["simulate", "--mechanism", path, "--poses", 3], ["effects", "--mechanism", path]]

    return make


def in_table(column: str, *, header: bool = False) -> Callable[[str, Path], list[list[object]]]:
    def make(text: str, folder: Path) -> list[list[object]]:
        frame = table(40)
        frame = frame.assign(**{f"{text} [degC]": range(40)} if header else {column: ["a", text] * 20})
        path, model = write(frame, folder / "t.csv"), saved(folder)
        whole = [["calibrate", path, "--mechanism", "irb6400r", "--out", folder / "out"], ["export", folder / "out"]]
        used = [[command, model, path] for command in ("predict", "compensate", "verify")]
        return [["check", path, "--mechanism", "irb6400r"], *used, *whole]

    return make


def foreign(place: str) -> Callable[[str, Path], list[list[object]]]:
    """A file of another program, with the text in its header, in its cells or above its header."""

    def make(text: str, folder: Path) -> list[list[object]]:
        frame = table(20)
        frame.columns = [*(f"A{i}" for i in range(1, 7)), *"XYZ", *map(str, frame.columns[9:])]
        frame = frame.assign(**({text: range(20)} if place == "header" else {"note": [text, "b"] * 10}))
        path, above = folder / "f.csv", f"{text}\n" * (place == "above")
        path.write_text(above + frame.to_csv(index=False), encoding="utf-8")
        (folder / "m.toml").write_text(f"join = {json.dumps(text)}\n[columns]\nJ1 = {json.dumps(text + ' [deg]')}\n")
        out = folder / "out.csv"
        return [
            ["import", path, "--mechanism", "irb6400r", "--guess", "--out", out],
            ["check", path, "--mechanism", "irb6400r"],
            ["import", path, "--map", out.with_suffix(".map.toml")],
            ["import", path, path, "--map", folder / "m.toml"],
            ["import", path, "--mechanism", "irb6400r", "--guess"],
        ]

    return make


def beside_table(kind: str) -> Callable[[str, Path], list[list[object]]]:
    """The name of a camera, a board or a surface."""

    def make(text: str, folder: Path) -> list[list[object]]:
        name = {"cameras": "camera", "board": "board", "surfaces": "plane"}[kind]
        keys = {
            "cameras": f"link = {json.dumps(text)}\nfocal_px = [1000, 1000]\ncentre_px = [500, 500]",
            "board": f"link = {json.dumps(text)}\ncolumns = 3\nrows = 3\npitch_mm = 20",
            "surfaces": "normal = [0, 0, 1]",
        }[kind]
        file = folder / f"{kind}.toml"
        file.write_text(f"[{name}.{json.dumps(text)}]\n{keys}\n", encoding="utf-8")
        data = write(table(40), folder / "t.csv")
        return [["check", data, "--mechanism", "irb6400r", f"--{kind}", file]]

    return make


def saved(folder: Path) -> Path:
    """A model in a folder, of a table with labels and a findable effect."""
    if not KNOWN:
        mechanism, made = robot(40, effects=("joint_compliance J2=2e-6",))
        fit = calibrate(mechanism, made.dataset, ["joint_compliance J2"])
        write_numbers(fit.record, fit.model, folder)
        KNOWN.update({name: (folder / name).read_text() for name in ("model.json", "report.json")})
    for name, text in KNOWN.items():
        (folder / name).write_text(text)
    return folder / MODEL


def texts_in(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of texts in JSON content, one of each kind: lists count with their first entry."""
    if isinstance(value, str):
        yield place
    for key, part in (
        value.items() if isinstance(value, dict) else list(enumerate(value))[:1] if isinstance(value, list) else ()
    ):
        yield from texts_in(part, (*place, key))


def in_json(name: str) -> Callable[[str, Path], list[list[object]]]:
    """Every text of a sealed model.json, or of report.json: one after the other, and all that can be read at once."""

    def written(content: dict[str, Any], own: Path) -> bool:
        """Return whether the written file can be read."""
        own.mkdir()
        saved(own)
        changed = content | {SEAL: seal(content)} if name == "model.json" else content
        (own / name).write_text(json.dumps(changed), encoding="utf-8")
        if name == "model.json":
            (own / "report.json").unlink()
        try:
            load_model(own) if name == "model.json" else load_result(own)
        except InputError:
            return False
        return True

    def make(text: str, folder: Path) -> list[list[object]]:
        data, every = write(table(6), folder / "t.csv"), folder / "every"
        saved(folder)
        commands, together = list[list[object]](), json.loads(KNOWN[name])
        for number, place in enumerate(texts_in(json.loads(KNOWN[name]))):
            own, changed = folder / f"{name}{number}", json.loads(KNOWN[name])
            put(changed, place, text)
            if written(changed, own):
                put(together, place, text)
            commands.append(["predict", own / MODEL, data] if name == "model.json" else ["explain", own, 1])
        assert written(together, every)
        if name == "model.json":
            return [*commands, ["export", every, "--nodes", 2, "--out", every / "out"], ["verify", every, data]]
        return [*commands, ["compare", every, folder], ["certificate", every], ["report", every]]

    return make


def put(content: Any, place: tuple[Any, ...], text: str) -> None:
    """The text at a place of JSON content."""
    for key in place[:-1]:
        content = content[key]
    content[place[-1]] = text


def in_particulars(text: str, folder: Path) -> list[list[object]]:
    saved(folder)
    (folder / "p.toml").write_text(f"serial = {json.dumps(text)}\ninstrument = {json.dumps(text)}\n")
    return [
        ["certificate", folder, "--particulars", folder / "p.toml"],
        ["certificate", folder, "--serial", text.replace("\0", "")],
    ]


FORMATS: dict[str, Callable[[str, Path], list[list[object]]]] = {
    **{f"TOML, {key}": described(key, ARM) for key in ("name", "convention", "kind", "joint", "surplus")},
    "hexapod, name": described("name", HEXAPOD),
    **{f"URDF, {place}": in_urdf(place) for place in ("ROBOT", "LINK", "JOINT")},
    "CSV, header": in_table("", header=True),
    **{
        f"CSV, {label}": in_table(label) for label in ("setup", "tool", "group", "camera", "marker", "on_plane", "note")
    },
    **{f"foreign, {place}": foreign(place) for place in ("header", "cells", "above")},
    **{kind: beside_table(kind) for kind in ("cameras", "board", "surfaces")},
    "model.json": in_json("model.json"),
    "report.json": in_json("report.json"),
    "particulars": in_particulars,
}
AT_ONCE = ("TOML, name", "URDF, ROBOT", "CSV, header", "CSV, setup", "board", "foreign, header")
WHOLE = {"model.json": pytest.mark.slow, "report.json": pytest.mark.slow}
"""Every text of a saved result by every command that reads it takes minutes."""
CASES = [
    pytest.param(form, kind, marks=() if form in AT_ONCE and kind in QUICK else WHOLE.get(form, pytest.mark.long))
    for form in FORMATS
    for kind in HOSTILE
]


@pytest.mark.long
@pytest.mark.parametrize(("form", "kind"), CASES)
def test_text_stays_text(form: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    commands = FORMATS[form](HOSTILE[kind], tmp_path)
    quick = form in AT_ONCE and kind in QUICK
    for words in commands[:2] if quick else commands:
        if words[0] == "calibrate" and kind not in SOURCE:
            words = [word for word in words if word not in ("--out", tmp_path / "out")]
        done = run(*words)
        if words[0] == "export" and not Path(str(words[1])).exists():
            continue
        said = done.stdout + done.stderr
        assert done.exit_code in (0, 2, 3), (words, done.stderr, done.exception)
        assert "Traceback" not in said
        assert not [c for c in said if c not in "\n\t\xa0\u2009" and not c.isprintable()], (words, said)
        forged = FORGED in said.splitlines()
        assert not forged or words[0] == "check", (words, said)
        assert said.splitlines().count(FORGED) < 2, (words, said)
        if done.exit_code == 2:
            assert len(done.stderr.splitlines()) == 1, (words, done.stderr)
            assert len(done.stderr) < 1500
        assert not list(tmp_path.rglob("CANARY")), words
    assert not list(Path.cwd().rglob("CANARY"))


UNKEPT = "could not be kept in a model file: file: Expected text without quotes"
STEERS = "holds control characters; expected a path"


@pytest.mark.parametrize("command", ["calibrate", "discover"])
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ('a"b.csv', UNKEPT), ("a\x1b[31m.csv", STEERS), ("a\\b.csv", UNKEPT), ("\udcff.csv", STEERS),
    ],
)  # fmt: skip
def test_a_name_that_no_model_may_hold_is_refused_at_once_and_printed_harmlessly(
    name: str, said: str, command: str, tmp_path: Path
) -> None:
    path = write(table(), tmp_path / name)
    line = one_line(run(command, path, "--mechanism", "irb6400r", "--out", tmp_path / "out", "--quiet"), 2)
    assert said in line
    assert line.isprintable()
    assert not (tmp_path / "out").exists()


def test_a_name_that_is_not_there_is_printed_harmlessly() -> None:
    line = one_line(run("calibrate", "a\x1b[31m.csv", "--mechanism", "irb6400r"), 2)
    assert "x1b[31m.csv' holds control characters" in line
