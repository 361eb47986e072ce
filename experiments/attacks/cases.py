"""Generate hostile values for every place that gpmodel reads: classes by fields by commands."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Any

import click
import pandas as pd

from gpmodel.cli.main import main
from gpmodel.texts import SEAL, seal

ARM = (files("robots") / "data" / "irb6400r.toml").read_text(encoding="utf-8")
URDF = (
    '<robot name="r"><link name="a"/><link name="b"/><link name="c"/><joint name="j" type="revolute">'
    '<parent link="a"/><child link="b"/><origin xyz="0.5 0 1" rpy="0 0.1 0"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1"/></joint><joint name="k" type="prismatic"><parent link="b"/><child link="c"/>'
    '<axis xyz="1 0 0"/><limit lower="0" upper="1"/></joint></robot>'
)
CODE = '*/int f(void);__attribute__((constructor))static void p(void){system("touch CANARY");}/*'
SIGHTS = {
    "cameras": '[camera.C]\nlink = "world"\nfocal_px = [2400.0, 2400.0]\ncentre_px = [1224.0, 1024.0]\n',
    "board": '[board.B]\nlink = "tool"\ncolumns = 5\nrows = 4\npitch_mm = 20.0\n',
    "surfaces": "probe_diameter_mm = 6\n[plane.A]\nnormal = [0, 0, 1]\noffset_mm = 12.5\n[line.L]\n"
    "direction = [1, 0, 0]\npoint_mm = [0, 0, 1]\n[sphere.S]\ndiameter_mm = 30\ncentre_mm = [900, 0, 500]\n",
    "map": "header = true\n[columns]\n"
    + "".join(
        f'{c} = "{c} [{u}]"\n' for c, u in (*((f"J{k}", "deg") for k in range(1, 7)), *((a, "mm") for a in "xyz"))
    )
    + '[tool.A]\nx = "x [mm]"\ny = "y [mm]"\nz = "z [mm]"\n',
}
"""Files that describe instruments, and the map of an import."""
VALUES = (
    "", "nan", "-1", "0", "1e400", "1e9", "9" * 400, "abc", 'x"""\nopen("CANARY", "w")\n"""', CODE, "$(touch CANARY)",
    "__import__('os').system('touch CANARY')", "a\x1b[31mRED\x07", "a\nfit to calibrate with; no warnings\nb",
    "a" * 5000, "../../x", "<script>alert(1)</script>", "@TERMS@ {0} %s", "J1", "\x00", "1:2:3", "[" * 300,
)  # fmt: skip
NUMBERS: tuple[Any, ...] = (None, True, -1, 0, 10**400, 1e308, [], {}, [[]], "x")
"""Values that replace a number in JSON."""
NEVER_RUN = ("discover", "evolve", "fleet", "completion", "joint")
"""Commands that are given no table, so that only their options are read."""
Words = list[str]


@dataclass(frozen=True)
class Case:
    """A name, and a function that writes the files into a folder and returns the words of the command line."""

    name: str
    make: Callable[[Path], Words]


def options() -> Iterator[Case]:
    """Every option and argument of every command."""
    context = click.Context(main)
    for name in main.list_commands(context):
        command = main.get_command(context, name)
        own = [] if command is None or name == "demo" else command.params
        for parameter, value in product([p for p in own if not getattr(p, "is_flag", False)], VALUES):
            if "\0" in value:
                continue  # no command line holds one
            given = [value] if parameter.param_type_name == "argument" else [parameter.opts[0], value]
            yield Case(f"option {name} {parameter.name}", lambda _, n=name, g=given: _usual(n, g))  # type: ignore[misc]


def _usual(name: str, given: Words) -> Words:
    table = ["missing.csv"] if name in NEVER_RUN else ["t.csv"]
    arm = ["--mechanism", "irb6400r"]
    words = {
        "check": [*table, *arm], "calibrate": [*table, *arm, "--out", "out"], "import": [*table, "--out", "i.csv"],
        "predict": ["model.json", *table], "verify": ["model.json", *table], "compensate": ["model.json", *table],
        "export": ["model.json", "--nodes", "2", "--out", "out"], "simulate": [*arm, "--poses", "3"],
        "poses": [*arm, "-n", "3"], "effects": arm, "certificate": ["."], "explain": [".", "1"], "compare": [".", "."],
        "report": ["."], "fleet": ["missing", *arm], "discover": [*table, *arm], "evolve": [*table, *arm],
    }.get(name, [])  # fmt: skip
    return [name, *words, *given] if given[0].startswith("-") else [name, *given, *words[1:]]


def tables() -> Iterator[Case]:
    """Headers, cells and added columns of a CSV table."""
    for column, value, part in product(range(9), VALUES, ("header", "cell", "column", "label")):
        for words in (["check", "h.csv", "--mechanism", "irb6400r"], ["predict", "model.json", "h.csv"],
                      ["verify", "model.json", "h.csv"], ["compensate", "model.json", "h.csv"]):  # fmt: skip

            def make(folder: Path, words: Words = words, place: tuple[int, str, str] = (column, value, part)) -> Words:
                (k, text, where), frame = place, pd.read_csv(folder / "t.csv", dtype=str)
                if where == "header":
                    frame.columns = [*frame.columns[:k], text, *frame.columns[k + 1 :]]
                elif where == "cell":
                    frame.iloc[7, k] = text
                else:
                    frame[f"{text} [mm]" if where == "column" else ("setup", "tool", "group")[k % 3]] = text
                frame.to_csv(folder / "h.csv", index=False)
                return words

            yield Case(f"table {part} {column} {words[0]}", make)


def descriptions() -> Iterator[Case]:
    """Values of a TOML description and of a URDF."""
    lines = ARM.splitlines()
    keyed = [k for k, line in enumerate(lines) if "=" in line and not line.startswith("#")]
    for k, value, command in product(keyed, VALUES, ("check", "simulate", "effects")):
        said = "\n".join([*lines[:k], f"{lines[k].split('=')[0]}= {json.dumps(value)}", *lines[k + 1 :]])
        yield Case(f"TOML {lines[k].split('=')[0].strip()} {command}", _described("arm.toml", said, command))
    for k, value, command in product(range(1, URDF.count('"'), 2), VALUES, ("check", "simulate", "effects")):
        parts = URDF.split('"')
        parts[k] = value.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;").replace("\n", "&#10;")
        yield Case(f"URDF {k} {command}", _described("arm.urdf", '"'.join(parts), command))


def sights() -> Iterator[Case]:
    """Values and names of tables in files that describe cameras, boards, surfaces and columns of a foreign file."""
    for kind, good in SIGHTS.items():
        lines = good.splitlines()
        for k, value in product(range(len(lines)), VALUES):
            key = lines[k].split("=")[0]
            new = f"[{key.strip('[]').split('.')[0]}.{json.dumps(value)}]" if key == lines[k] else None
            items = (json.dumps(value), f"[{json.dumps(value)}, 1, 2]", value) if new is None else ("",)
            for n, item in enumerate(items):
                text = "\n".join([*lines[:k], new or f"{key}= {item}", *lines[k + 1 :]])
                yield Case(f"sight {kind} {key.strip()} {n}", _seen(kind, text))


def _seen(kind: str, text: str) -> Callable[[Path], Words]:
    def make(folder: Path) -> Words:
        for name, good in SIGHTS.items():
            (folder / f"{name}.toml").write_text(text if name == kind else good, encoding="utf-8")
        arm = ["--mechanism", "irb6400r"]
        if kind == "map":
            return ["import", "t.csv", "--map", "map.toml", "--out", "i.csv"]
        if kind == "surfaces":
            return ["check", "planes.csv", *arm, "--surfaces", "surfaces.toml"]
        return ["check", "camera.csv", *arm, "--cameras", "cameras.toml", "--board", "board.toml"]

    return make


def _described(file: str, text: str, command: str) -> Callable[[Path], Words]:
    def make(folder: Path) -> Words:
        (folder / file).write_text(text, encoding="utf-8")
        table = {"check": ["t.csv"], "simulate": ["--poses", "3"], "effects": []}[command]
        return [command, *table, "--mechanism", file]

    return make


def places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Leaves of JSON content, one of each kind: lists count with their first entry."""
    if not isinstance(value, dict | list):
        yield place, value
    inner = value.items() if isinstance(value, dict) else list(enumerate(value))[:1] if isinstance(value, list) else ()
    for key, part in inner:
        yield from places(part, (*place, key))


def saved(content: dict[str, Any], name: str) -> Iterator[Case]:
    """Every text and number of a sealed model.json, or of report.json."""
    commands = {
        "model.json": (["predict", "model.json", "t.csv"], ["compensate", "model.json", "t.csv"],
                       ["verify", "model.json", "t.csv"], ["export", "model.json", "--nodes", "2", "--out", "out"]),
        "report.json": (["explain", ".", "1"], ["compare", ".", "before"], ["certificate", "."]),
    }[name]  # fmt: skip
    for place, old in places(content):
        for value, words in product(VALUES if isinstance(old, str) else NUMBERS, commands):

            def make(folder: Path, words: Words = words, place: tuple[Any, ...] = place, value: Any = value) -> Words:
                changed = json.loads(json.dumps(content))
                inner = changed
                for key in place[:-1]:
                    inner = inner[key]
                inner[place[-1]] = value
                changed = changed | {SEAL: seal(changed)} if name == "model.json" else changed
                (folder / name).write_text(json.dumps(changed), encoding="utf-8")
                return words

            yield Case(f"{name} {'.'.join(map(str, place))} {words[0]}", make)
