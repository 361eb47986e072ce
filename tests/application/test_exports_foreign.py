"""Test that text of a table or a description stays text in generated source."""

import ast
import ctypes
import json
import re
import shutil
import subprocess
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run
from exports_cases import fitted, fresh, points
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import Model
from gpmodel.application.exports import make, programs
from gpmodel.application.exports.forward import forward_of
from gpmodel.application.exports.make import exports_of, merged, parts_of
from gpmodel.application.exports.programs import program_read, program_text
from gpmodel.application.exports.sample import Place
from gpmodel.application.exports.sources import c_text
from gpmodel.application.model_file import SavedModel
from gpmodel.errors import InputError
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice, choice_of
from gpmodel.model.error_model import ErrorModel, Placement
from gpmodel.numerics import se3

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
    made = merged([part() for part in parts_of(saved, Place.of(saved))[:-1]])  # the grid is a table
    assert set(made.refused) == {"exports/ur_kinematics.yaml", "exports/robodk.csv"}
    return {e.file: e.text for e in made.files}


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
        assert any("the convention of the controller is not known" in line for line in set(lines) - set(bare))
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


EFFECTS = {
    "irb6400r": ("base_compliance=3e-7", "gear_harmonic J4=60 arcsec"),
    "panda": ("J2.moving:Tz:step(x)*abs(y)=0.4 mm",),
}


def c_inverse(model: Model, folder: Path) -> Callable[[np.ndarray, np.ndarray], tuple[int, np.ndarray]]:
    """Compile gpmodel_compensate of a model: status and corrected joint values at joint values and inputs."""
    forward = forward_of(model.saved, Place.of(model.saved))
    count = len(model.mechanism.joints)
    (folder / "model.c").write_text(c_text(forward, "", np.zeros((1, count + len(forward.inputs) + 3))))
    done = subprocess.run(
        ["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", str(folder / "model.c"), "-lm",
         "-o", str(folder / "model.so")], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    inverse, double = ctypes.CDLL(str(folder / "model.so")).gpmodel_compensate, ctypes.POINTER(ctypes.c_double)

    def at(q: np.ndarray, inputs: np.ndarray) -> tuple[int, np.ndarray]:
        start, out = np.ascontiguousarray(q), np.empty(count)
        status = inverse(start.ctypes.data_as(double), inputs.ctypes.data_as(double), out.ctypes.data_as(double))
        return status, out

    return at


GANTRY = 'convention = "modified"\n' + "".join(
    f'[[joint]]\nkind = "prismatic"\nalpha_deg = {alpha}\ntheta_deg = {alpha}\nlower_mm = 0\nupper_mm = 900\n'
    for alpha in (0, 90, 90)
)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(("off", "status", "word"), [(9, 0, "ok"), (15, 2, "large move")])
def test_a_slide_in_c_moves_as_far_as_with_compensate(off: int, status: int, word: str, tmp_path: Path) -> None:
    (tmp_path / "gantry.toml").write_text(GANTRY)
    model = gp.simulate(gp.load_mechanism(str(tmp_path / "gantry.toml")), [f"J1.moving:Tz:1={off} mm"], poses=9).truth
    q = np.full(3, 0.4)
    assert c_inverse(model, tmp_path)(q, np.zeros(1))[0] == status
    assert model.compensate(pd.DataFrame([q], columns=["J1 [m]", "J2 [m]", "J3 [m]"]))["status"].tolist() == [word]


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb6400r", "panda"])
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_inverse_in_c_is_that_of_compensate(name: str, tmp_path: Path) -> None:
    model = fitted(name, EFFECTS[name])
    inverse = c_inverse(model, tmp_path)
    q = fresh(model, 200)
    frame = pd.DataFrame({f"{j.name} [rad]": v for j, v in zip(model.mechanism.joints, q.T, strict=True)})
    expected = model.compensate(frame)
    wanted = expected.filter(regex=r"^corrected_").to_numpy(dtype=float)
    wanted = np.radians(wanted) if "[deg]" in "".join(expected.filter(regex="^corrected_").columns) else wanted
    inputs = np.zeros(16)
    for k, given in enumerate(forward_of(model.saved, Place.of(model.saved)).inputs):
        inputs[k] = float(choice_of(model.mechanism).payload or 0.0) if given == "payload" else 0.0
    found = np.full_like(q, np.nan)
    for k, row in enumerate(q):
        failed, out = inverse(row, inputs)
        if failed:
            np.testing.assert_array_equal(out, row)
            continue
        found[k] = out
    ok = (expected["status"] == "ok").to_numpy()
    both = ok & np.isfinite(found).all(axis=1)
    assert both.sum() >= 0.95 * ok.sum() > 100
    assert np.linalg.norm(points(model, found[both]) - points(model, wanted[both]), axis=1).max() < 1e-6


EXPONENTIAL = {".tex": ("e^{", "\\xi_"), ".py": ("np.exp(", "twists["), ".c": ("exp(", "twists[")}
"""By suffix: how it is written, and what its line has."""


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_a_bump_is_found_named_and_exported_with_one_exponential() -> None:
    arm = gp.load_mechanism("irb6400r")
    planted = "J2.moving:Rz:exp(-13*square(J2 - 0.3))=0.8 mrad"
    made = gp.simulate(arm, [planted], poses=60, noise="0.02 mm", seed=3)
    found = gp.discover(arm, made.table, search=gp.Search(runs=0), holdout=0.3)
    (finding,) = found.findings
    assert finding.name.startswith("bump of J2 at 17.")
    saved = found.model.saved
    texts = {Path(export.file).suffix: export.text for export in exports_of(saved, Place.of(saved)).files}
    for suffix, (written, place) in EXPONENTIAL.items():
        (line,) = [line for line in texts[suffix].splitlines() if written in line and place in line]
        assert line.count(written) == 1


def test_an_effect_that_is_undefined_where_it_was_fitted_is_exported_nowhere() -> None:
    arm = gp.load_mechanism("irb6400r")
    saved = gp.calibrate(arm, gp.simulate(arm, poses=40, seed=3).table).model.saved
    first, *others = saved.model.effects
    odd = replace(first, terms=(replace(first.terms[0], basis=gp.Expression("1/(J1-J1)")),))
    saved = replace(saved, model=replace(saved.model, effects=(odd, *others)))
    with pytest.raises(gp.InputError, match="is infinite or undefined at some poses"):
        exports_of(saved, Place.of(saved))


POINTS = ["x [mm]", "y [mm]", "z [mm]"]


@pytest.fixture(scope="module")
def model() -> Model:
    mechanism, made = robot(50, 3, "irb6400r", effects=("joint_compliance J2=2e-7",))
    return calibrate(mechanism, made.dataset, ["joint_compliance J2"]).model


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three targets, the second of which asks for a move beyond a limit."""
    path = tmp_path_factory.mktemp("targets") / "targets.csv"
    q = [[10, 5, 20, 30, 40, 50], [0, 0, 0, 0, 60, 399.9999999], [-100, -20, 35, -120, -50, 100]]
    pd.DataFrame(q, columns=[f"J{i + 1} [deg]" for i in range(6)]).to_csv(path, index=False)
    return path


@pytest.mark.parametrize("file", ["cell 1.mod", "cell.dat"])
def test_what_is_written_reaches_the_targets(model: Model, targets: Path, tmp_path: Path, file: str) -> None:
    model.save(tmp_path / "model.json")
    done = run("compensate", tmp_path / "model.json", targets, "--max-move", "0.5", "--out", tmp_path / file)
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / file).read_text()
    in_degrees, frames = program_read(text)
    joints = {row: np.radians(values) for row, values in in_degrees.items()}
    corrected = model.compensate(targets, max_move=0.5)
    given = corrected["status"].isin(["ok", "outside the measured range"])
    assert set(joints) == set(frames) == {i + 1 for i in np.flatnonzero(given)}
    for row in sorted(set(range(1, 4)) - set(joints)):
        assert f"Row {row}: no target, {corrected['status'][row - 1]}." in text
    q = np.array([joints[row] for row in sorted(joints)])
    np.testing.assert_allclose(np.degrees(q), corrected.loc[given, [c for c in corrected if "corrected" in c]])
    headers = [f"J{i + 1} [rad]" for i in range(6)]
    reached = model.predict(pd.DataFrame(q, columns=headers))[POINTS].to_numpy()
    nominal = se3.chain(model.mechanism.transforms(np.radians(pd.read_csv(targets).to_numpy()[given])))[-1]
    placed = model.saved.placement
    wanted = 1e3 * (placed.registration[""] @ nominal @ placed.tool[""])[:, :3, 3]
    assert np.abs(reached - wanted).max() < 1e-3
    flange = se3.chain(model.mechanism.transforms(q))[-1]
    for row, frame in zip(sorted(frames), flange, strict=True):
        found = frames[row]
        assert np.abs(found[:3, 3] - frame[:3, 3]).max() < 1e-6
        assert Rotation.from_matrix(found[:3, :3] @ frame[:3, :3].T).magnitude() < 1e-7
    quarters = [[float(v) for v in said.split(",")] for said in re.findall(r"\],\[([-\d,]+),0\],\[9E9", text)]
    assert quarters == ([[np.floor(np.degrees(v[i]) / 90) for i in (0, 3, 5)] for v in q] if "MODULE" in text else [])


@pytest.mark.parametrize(("language", "format_numbers"), [("RAPID", "_numbers"), ("KRL", "_fields")])
def test_the_head_says_how_far_the_read_program_is_off(
    model: Model, targets: Path, monkeypatch: pytest.MonkeyPatch, language: programs.Language, format_numbers: str
) -> None:
    corrected = model.compensate(targets)
    assert re.search(r"Read back: joint values to \de-1\d deg or mm, frames to \de-\d+ mm and \S+ deg", (
        model.program(corrected, language)))  # fmt: skip
    whole = getattr(programs, format_numbers)
    monkeypatch.setattr(programs, format_numbers, lambda *given: re.sub(r"(\.\d)\d+", r"\1", whole(*given)))
    assert "Read back: joint values to 0." in model.program(corrected, language)


def test_names_are_those_of_a_program(model: Model, targets: Path) -> None:
    corrected = model.compensate(targets)
    for language, first in (("RAPID", "MODULE p_1_cell_ok"), ("KRL", "DEFDAT p_1_cell_ok PUBLIC")):
        assert model.program(corrected, language, "1 cell-ok").splitlines()[0] == first  # type: ignore[arg-type]


@pytest.mark.long
def test_what_is_no_list_of_targets_is_refused(model: Model, targets: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 columns corrected_JOINT and 6 joints"):
        model.program(pd.read_csv(targets), "RAPID")
    with pytest.raises(InputError, match="expected RAPID or KRL"):
        model.program(model.compensate(targets), "G-code")  # type: ignore[arg-type]
    model.save(tmp_path / "model.json")
    out = tmp_path / "none.mod"
    said = one_line(run("compensate", tmp_path / "model.json", targets, "--max-move", "1e-9", "--out", out), 2)
    assert "none of the 3 targets has corrected joint values" in said
    assert not out.exists()
