"""Text of a table or a description in generated source: it stays text, whatever it is."""

import ast
import json
import re
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cli_cases import robot

from gpmodel.api.calibrate import calibrate
from gpmodel.application.exports import make
from gpmodel.application.exports.make import parts_of, together
from gpmodel.application.exports.programs import program_text
from gpmodel.application.exports.sample import Place
from gpmodel.application.model_file import SavedModel
from gpmodel.errors import InputError
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.model.error_model import ErrorModel, Placement

HOSTILE = {
    "python": 'x"""\nopen("CANARY", "w")\n"""',
    "c": '*/int system(const char*);__attribute__((constructor))static void p(void){system("touch CANARY");}/*',
    "placeholder": "*@TERMS@/ @COLUMNS@ @NOTE@ @FIXED@",
    "latex": "\\write18{touch CANARY} % } $",
    "toml": 'a"\nconvention = "standard"\n[[joint]]\n#',
    "yaml": "a: b\nJ1_x: 1.0\n# !!python/object/apply:os.system ['touch CANARY']",
    "xml": '--><robot name="other"><!--<!DOCTYPE a [<!ENTITY b "c">]>',
    "lines": "a\r\x0bb\x85c\u2028d\x1b[31m",
}
"""By the language that each leaves a string or a comment of."""


@cache
def benign() -> SavedModel:
    mechanism, made = robot(40, 3, "irb6400r")
    half = np.arange(40) % 2 == 0
    labels = {"setup": np.where(half, "east", "west"), "tool": np.where(half, "ball", "cup")}
    table = replace(made.dataset, labels=labels, extras={"t": np.linspace(0, 1, 40)}, extra_units={"t": "degC"})
    return calibrate(mechanism, table, ["J1.moving:Rz:t", "J2.moving:Ry:row*sin(J3)"], standard=()).model.saved


def named(saved: SavedModel, text: str) -> SavedModel:
    """The model with a text in every place that a file can put one."""
    assert saved.measured is not None
    mechanism, (east, west) = saved.mechanism, (f"{text}1", f"{text}2")
    assert isinstance(mechanism, LoadedMechanism)
    renamed = {"east": east, "west": west, "ball": east, "cup": west}
    data = saved.measured.dataset
    labels = {name: np.array([renamed[v] for v in values]) for name, values in data.labels.items()}
    columns = tuple(f"{text}{i}" for i in range(len(data.joints)))
    effects = tuple(replace(e, name=f"{text} {e.name}") for e in saved.model.effects)
    placed = saved.placement
    return replace(
        saved,
        model=ErrorModel(replace(mechanism, bare=replace(mechanism.bare, name=text)), effects),  # type: ignore[type-var]
        measured=replace(saved.measured, dataset=replace(data, labels=labels, columns=columns, source=text)),
        placement=Placement(
            {renamed[k]: v for k, v in placed.registration.items()},
            {renamed[k]: v for k, v in placed.tool.items()},
            placed.anchors,
        ),
    )


def code(file: str, text: str) -> object:
    """Return the parts of a source that are no name, text or comment."""
    match Path(file).suffix:
        case ".py":
            tree = ast.parse(text)
            return [type(node).__name__ for node in ast.walk(tree)], len(tree.body)
        case ".c" | ".h":
            return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        case ".toml":
            return {**tomllib.loads(text), "name": ""}
        case ".yaml":
            return [line for line in text.splitlines() if not line.startswith("#")]
        case ".csv":
            return [line.count(",") for line in text.splitlines() if not line.startswith("#")]
        case ".tex":
            return re.findall(r"\\(?!_|%| )[A-Za-z]*", text)
    return [(e.tag, e.get("name") if e.tag != "robot" else "") for e in ET.fromstring(text).iter()]


EACH = [pytest.param(text, id=kind, marks=pytest.mark.long) for kind, text in HOSTILE.items()]


@pytest.mark.long
@pytest.mark.parametrize("text", [pytest.param("".join(HOSTILE.values()), id="all"), *EACH])
def test_no_text_leaves_its_place_and_none_is_run(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(make, "tested", lambda source: seen.append(source) or dict.fromkeys(make.PRINTED, np.nan))
    seen: list[str] = []
    wanted, found = written("plain"), written(text)
    assert {file: code(file, t) for file, t in found.items()} == {file: code(file, t) for file, t in wanted.items()}
    assert all(line.isprintable() for t in found.values() for line in t.split("\n"))
    assert seen[-1]
    assert "CANARY" not in seen[-1]
    assert not (tmp_path / "CANARY").exists()


@cache
def written(text: str) -> dict[str, str]:
    saved = named(benign(), text)
    made = together([part() for part in parts_of(saved, Place.of(saved))[:-1]])  # the grid is a table
    assert set(made.refused) == {"exports/ur_kinematics.yaml", "exports/robodk.csv"}
    return {e.file: e.text for e in made.made}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_a_robot_program_keeps_texts_in_its_comments(text: str) -> None:
    import pandas as pd

    mechanism = MechanismChoice("irb6400r").load()
    called = replace(mechanism, bare=replace(mechanism.bare, name=text))  # type: ignore[type-var]
    frame = pd.DataFrame({f"corrected_J{i} [deg]": [0.0, 1.0] for i in range(1, 7)} | {"status": ["ok", text]})
    for language in ("RAPID", "KRL"):
        lines = program_text(called, frame, language, text).splitlines()
        comment = "  !" if language == "RAPID" else "  ;"
        bare = [line for line in lines if not line.startswith(comment)]
        assert len(bare) == 6
        assert bare[-1] in ("ENDMODULE", "ENDDAT")


@pytest.mark.parametrize("columns", [["*/ x", *"abcde"], ["J1"] * 6, ["a"], ["J1", "J2", "J3", "J4", "J6", "J5"]])
def test_columns_of_a_model_are_read_as_those_of_a_table(columns: list[str], tmp_path: Path) -> None:
    from gpmodel.api.model import Model, load_model
    from gpmodel.texts import seal

    Model(benign()).save(tmp_path / "model.json")
    content = json.loads((tmp_path / "model.json").read_text())
    content["measured"]["columns"] = columns
    (tmp_path / "model.json").write_text(json.dumps(content | {"sha256": seal(content)}))
    with pytest.raises(InputError, match=r"measured\.columns: expected the 6 joints"):
        load_model(tmp_path / "model.json")
