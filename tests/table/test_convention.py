"""Test that joint values leave the program in the signs and zeros in which they came in."""

import re
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, run
from instances import some

import gpmodel as gp
from gpmodel.api.model import Model
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.table.convention import convention_text, read_convention, sum_of
from gpmodel.table.foreign import ColumnMap, joint_convention
from gpmodel.table.layout import read_sheets

MAP = """[columns]
J1 = "0 - A1 [deg]"
J2 = "90 + A2 [deg]"
J3 = "A3 + A2 [deg]"
J4 = "0 - c4 [deg]"
J5 = "A5 [deg]"
J6 = "0 - A6 [deg]"
x = "X [mm]"
y = "Y [mm]"
z = "Z [mm]"
"""
SAID = "J1 = -A1; J2 = 90 + A2; J3 = A3 + A2; J4 = -A4; J5 = A5; J6 = -A6"
TARGETS = [[12.5, -65.0, 100.25, -30.0, 40.0, -50.125], [-10.0, -100.1, 110.0, 0.0, 35.5, 20.0]]
PROGRAMS = {
    "cell.src": """&ACCESS RVP
DEF cell( )
  ;FOLD PTP HOME {A1 5,A2 5}
  PTP {A1 12.5,A2 -65.00,A3 100.25,A4 -30,A5 40,A6 -50.125,E1 500.5,E2 0.0}
  PTP {E6AXIS: A1 -10, A2 -100.1, A3 110, A4 0, A5 35.5, A6 +20, E1 0, E2 33.3} C_PTP
  LIN {X 1500,Y 200,Z 900,A 0,B 90,C 0}
END
""",
    "cell.mod": """MODULE M
  ! old [[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]]
  CONST jointtarget j1:=[[12.5,-65,100.25,-30,40,-50.125],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p1:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  MoveAbsJ [[-10,-100.1,110,0,35.5,20],[250,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;
ENDMODULE
""",
    "cell.ls": """/POS
P[1:"a"]{
   GP1:\n\tUF : 0, UT : 1,
\tJ1=    12.500 deg,\tJ2=   -65.000 deg,\tJ3=   100.250 deg,
\tJ4=   -30.000 deg,\tJ5=    40.000 deg,\tJ6=   -50.125 deg,
\tE1=   500.000  mm
   GP2:\n\tUF : 0, UT : 1,\n\tJ1= 7 deg
};
P[2]{
   GP1:\n\tUF : 0, UT : 1,
\tJ1= -10 deg,\tJ2= -100.1 deg,\tJ3= 110 deg, J4= 0 deg,\tJ5= 35.5 deg,\tJ6= 20 deg\n};
/END
""",
    "cell.script": f"""def f():
  q1 = {np.radians(TARGETS[0]).round(10).tolist()}
  movej(q1, a=1.4)
  # movej([0,0,0,0,0,0])
  movej({np.radians(TARGETS[1]).round(10).tolist()})
  movel(p[0.1,0,0.5,0,0,0])
end
""",
}


def of_controller(q: Array) -> Array:
    """The controller's values, deg, of joint values of the description, deg, by the map above."""
    a2 = q[:, 1] - 90.0
    return np.column_stack([-q[:, 0], a2, q[:, 2] - a2, -q[:, 3], q[:, 4], -q[:, 5]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table that was imported from a controller with other signs and zeros, its model, and one without errors."""
    path = tmp_path_factory.mktemp("signs")
    made = gp.simulate("irb6400r", ["joint_compliance J2=2e-7"], poses=40, noise="0.02mm", seed=4)
    values = np.hstack([of_controller(np.degrees(made.table.q)), 1e3 * made.table.position])
    head = [*(f"A{i}" for i in range(1, 7)), *"XYZ"]
    pd.DataFrame(values, columns=head).to_csv(path / "raw.csv", index=False)
    (path / "map.toml").write_text(MAP)
    done = run("import", path / "raw.csv", "--map", path / "map.toml", "--out", path / "table.csv")
    assert done.exit_code == 0, done.output
    saved = gp.calibrate("irb6400r", path / "table.csv", ["joint_compliance J2"]).model.saved
    Model(saved).save(path / "model.json")
    Model(replace(saved, theta=0.0 * saved.theta)).save(path / "zero.json")
    for name, text in PROGRAMS.items():
        (path / name).write_bytes(text.encode())
    return path


def test_the_convention_is_kept_from_the_import_to_the_model(folder: Path) -> None:
    assert set(pd.read_csv(folder / "table.csv")["convention"]) == {SAID}
    known = gp.load_model(folder / "model.json").saved.convention
    assert known is not None
    assert known.text == SAID
    assert known.axes == tuple(f"A{i}" for i in range(1, 7))
    q = np.radians(np.random.default_rng(0).uniform(-170.0, 170.0, (20, 6)))
    np.testing.assert_allclose(np.degrees(known.of_controller(q)), of_controller(np.degrees(q)), atol=1e-12)
    np.testing.assert_allclose(known.of_description(known.of_controller(q)), q, atol=1e-14)


@pytest.mark.parametrize("name", some(list(PROGRAMS), "cell.src", "cell.ls"))
def test_a_program_is_written_again_in_the_convention_of_the_controller(
    folder: Path, tmp_path: Path, name: str
) -> None:
    out, given = tmp_path / f"corrected{Path(name).suffix}", PROGRAMS[name]
    done = run("compensate", folder / "zero.json", folder / name, "--out", out)
    assert done.exit_code == 0, done.output
    lines = [line for line in out.read_text().splitlines() if " gpmodel: " not in line]
    assert lines == given.splitlines()
    assert name == "cell.ls" or SAID in " ".join(re.findall(r"gpmodel: (.*)", out.read_text()))
    model = gp.load_model(folder / "model.json")
    corrected = model.compensate(folder / name)
    columns = [f"corrected_J{i} [deg]" for i in range(1, 7)]
    wanted = of_controller(corrected[columns].to_numpy())
    (tmp_path / f"again{out.suffix}").write_text(model.rewrite(folder / name, corrected))
    again = model.predict(tmp_path / f"again{out.suffix}")
    if name != "cell.ls":
        with pytest.raises(InputError, match=r"again\.\w+: its joint targets are corrected"):
            model.compensate(tmp_path / f"again{out.suffix}")
    sent = of_controller(np.degrees(again[[f"J{i} [rad]" for i in range(1, 7)]].astype(float).to_numpy()))
    np.testing.assert_allclose(sent, wanted, atol=1e-7)
    assert 0.01 < np.abs(wanted - TARGETS).max() < 1.0
    kept = [number for number in re.findall(r"E[12] [\d.]+|\[250,|E1= +\S+ +mm|\{X.*", given)]
    assert all(text in (tmp_path / f"again{out.suffix}").read_text() for text in kept)


def test_targets_become_a_program_of_the_controller(folder: Path, tmp_path: Path) -> None:
    sent = pd.DataFrame(TARGETS, columns=[f"controller_A{i} [deg]" for i in range(1, 7)])
    sent.to_csv(tmp_path / "sent.csv", index=False)
    for out in ("cell.dat", "cell.mod"):
        done = run("compensate", folder / "zero.json", tmp_path / "sent.csv", "--out", tmp_path / out)
        assert done.exit_code == 0, done.output
        text = (tmp_path / out).read_text()
        assert SAID in text.replace("\n  ; ", " ").replace("\n  ! ", " ")
        assert "CAUTION" not in text
        listed = [[f"{v:.9f}" for v in row] for row in TARGETS]
        fields = ["".join(f"A{i} {v}," for i, v in enumerate(row, 1))[:-1] for row in listed]
        assert all((f if out == "cell.dat" else ",".join(row)) in text for f, row in zip(fields, listed, strict=True))
    table = gp.load_model(folder / "model.json").compensate(tmp_path / "sent.csv")
    changed = table[[f"to_controller_A{i} [deg]" for i in range(1, 7)]].to_numpy()
    np.testing.assert_allclose(changed, of_controller(table.filter(regex="corrected_").to_numpy()), atol=1e-9)
    assert 0.01 < np.abs(changed - TARGETS).max() < 1.0


@pytest.mark.long
def test_proposed_poses_are_given_in_both_conventions_and_read_back(folder: Path, tmp_path: Path) -> None:
    chosen = gp.choose_poses(after=folder / "model.json", count=3, criterion="spread", collisions=False)
    table = chosen.to_dataframe()
    np.testing.assert_allclose(table.filter(regex="^controller_"), of_controller(np.degrees(chosen.q)), atol=1e-9)
    measured = table.assign(**{f"{axis} [mm]": 1.0 for axis in "xyz"})
    bare = measured.drop(columns=[c for c in measured if str(c).startswith("J")])
    for frame in (measured, bare):
        data = gp.read_table(frame, "irb6400r")
        np.testing.assert_allclose(data.q, chosen.q, atol=1e-12)
        assert data.convention == SAID
        assert not data.extras
    made = gp.load_model(folder / "model.json").export()
    assert all(SAID in text for text in (made.exports.files[0].text, made.exports.files[0].notes[-1]))
    for name in ("model.py", "model.c"):
        (text,) = [e.text for e in made.exports.files if e.file == f"exports/{name}"]
        assert "Convention: joint values have the signs and zeros of the description" in " ".join(text.split())


TRACK = """[[joint]]
name = "E1"
kind = "prismatic"
alpha_deg = -90
a_mm = 0
d_mm = 0
theta_deg = 0
lower_mm = 0
upper_mm = 3000

[[joint]]"""


@pytest.fixture(scope="module")
def track(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm on a linear track, its poses as a program whose A1, A4 and A6 have the opposite sign, and its points."""
    path = tmp_path_factory.mktemp("track")
    head, _, rows = files("robots").joinpath("data/irb6400r.toml").read_text().partition("[[joint]]")
    (path / "track.toml").write_text(f"{head}{TRACK}{rows.replace('alpha_deg = 0', 'alpha_deg = 90', 1)}")
    made = gp.simulate(gp.load_mechanism(path / "track.toml"), [], poses=30, noise="0.02mm", seed=4)
    c = np.degrees(made.table.q[:, 1:]) * [-1, 1, 1, -1, 1, -1]
    axes = [",".join(f"A{i} {v:.5f}" for i, v in enumerate(row, 1)) for row in c]
    lines = [f"XP{k}={{{a},E1 {1e3 * q[0]:.3f},E2 0}}" for k, (a, q) in enumerate(zip(axes, made.table.q, strict=True))]
    (path / "raw.dat").write_text("\n".join(lines) + "\n")
    (path / "two.dat").write_text("\n".join(lines[:2]) + "\n")
    (path / "e3.dat").write_text(lines[0].replace("E1", "E3"))
    said = "E1 = E1; J1 = -A1; J2 = A2; J3 = A3; J4 = -A4; J5 = A5; J6 = -A6"
    made.table.to_dataframe().drop(columns="row").assign(convention=said).to_csv(path / "table.csv", index=False)
    pd.DataFrame(1e3 * made.table.position, columns=list("xyz")).to_csv(path / "points.csv", index=False)
    return path


def test_a_program_with_a_linear_track_is_corrected(track: Path) -> None:
    saved = gp.calibrate(gp.load_mechanism(track / "track.toml"), track / "table.csv").model.saved
    model, zero = Model(saved), Model(replace(saved, theta=0.0 * saved.theta))
    again = zero.rewrite(track / "two.dat", zero.compensate(track / "two.dat"))
    assert [line for line in again.splitlines() if "gpmodel" not in line] == (
        track / "two.dat"
    ).read_text().splitlines()
    text = model.program(model.compensate(track / "two.dat").assign(**{"E2 [deg]": 12.0}), "RAPID")
    assert len(re.findall(r"jointtarget.*\[\d+\.\d{9},12\.000000000(?:,9E9){4}\]", text)) == 2
    with pytest.raises(InputError, match=r"e3.dat, line 1: no E1, the axis of joint 'E1'; expected E1, A1"):
        model.compensate(track / "e3.dat")


@pytest.mark.long
def test_a_program_with_a_linear_track_is_imported(track: Path, tmp_path: Path) -> None:
    given = ("--mechanism", track / "track.toml", "--guess", "--yes", "--out", tmp_path / "table.csv")
    assert run("import", track / "raw.dat", track / "points.csv", *given).exit_code == 0
    table = pd.read_csv(tmp_path / "table.csv")
    assert set(table["convention"]) == set(pd.read_csv(track / "table.csv")["convention"])


def test_the_caution_stays_where_the_convention_is_not_known(folder: Path, tmp_path: Path) -> None:
    table = pd.read_csv(folder / "table.csv").drop(columns="convention")
    model = gp.calibrate("irb6400r", table).model
    model.save(tmp_path / "model.json")
    (tmp_path / "cell.mod").write_text(
        PROGRAMS["cell.mod"].replace("-65", "15").replace("100.25", "10").replace("-100.1", "15").replace("110", "10")
    )
    done = run("compensate", tmp_path / "model.json", tmp_path / "cell.mod", "--out", tmp_path / "out.mod")
    assert "CAUTION" in done.stderr
    assert "CAUTION" in (tmp_path / "out.mod").read_text()
    mixed = pd.read_csv(folder / "table.csv")
    mixed.loc[0, "convention"] = SAID.replace("-A1", "A1")
    assert gp.read_table(mixed, "irb6400r").convention == ""
    (tmp_path / "other.csv").write_text(mixed.assign(convention=SAID.replace("-A1", "A1")).to_csv(index=False))
    said = one_line(run("verify", folder / "model.json", tmp_path / "other.csv"), 2)
    assert "other.csv was imported with J1 = A1; " in said
    assert "expected equal signs and zeros" in said
    done = run("predict", folder / "model.json", folder / "table.csv", "--out", tmp_path / "predicted.csv")
    assert f"joint columns of table.csv are read in the signs and zeros of the description: {SAID}" in done.stderr
    mixed["convention"] = "J1 = sin(A1)"
    with pytest.raises(InputError, match="no formula of joint 'J2'; expected one formula a joint"):
        gp.read_table(mixed, "irb6400r")


BAD = [
    ("cell.src", "A2 -65.00,", "", "line 4: .* is no number for every axis; expected A1 to A6"),
    ("cell.script", "movej(q1", "movej(q2", "line 3: 'movej.q2' is no list of six numbers; expected one, in rad"),
    ("cell.src", "PTP {E6AXIS:", "PTP_REL {E6AXIS:", "line 5: 'PTP_REL' is a relative motion; expected joint targets"),
    ("cell.ls", "J1=", "W=", "no joint target of Fanuc; expected P"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "said"), BAD)
def test_a_program_that_is_not_read_whole_is_refused(
    folder: Path, tmp_path: Path, name: str, old: str, new: str, said: str
) -> None:
    (tmp_path / name).write_text(PROGRAMS[name].replace(old, new))
    done = run("compensate", folder / "zero.json", tmp_path / name, "--out", tmp_path / f"out{Path(name).suffix}")
    assert re.search(said, one_line(done, 2))
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("formulas", "said"),
    [
        (["0 - q1 [deg]", "q2 + q1 [deg]"], "J1 = -q1; J2 = q2 + q1"),
        (["1.5707963267948966 - q1 [rad]", "q2 [rad]"], "J1 = 90 - q1; J2 = q2"),
        (["q2 [deg]", "q1 [deg]"], "J1 = q2; J2 = q1"),
        (["2*q1 [deg]", "q2 [deg]"], ""),
        (["57.29578*q1 [deg]", "q2 [deg]"], ""),
        (["q1 [deg]", "q2 + q1 [rad]"], ""),
        (["sin(q1) [deg]", "q2 [deg]"], ""),
        (["q1 + q2 [deg]", "q2 + q1 [deg]"], ""),
    ],
)
def test_a_map_of_joints_is_a_convention_if_it_can_be_undone(
    tmp_path: Path, formulas: Sequence[str], said: str
) -> None:
    (tmp_path / "raw.csv").write_text("q1,q2,x\n1,2,3\n4,5,6\n")
    (sheet,) = read_sheets(tmp_path / "raw.csv")
    columns = ColumnMap({f"J{i}": text for i, text in enumerate(formulas, 1)} | {"x": "x [mm]"})
    assert joint_convention(sheet, columns) == said


def test_a_formula_is_a_sum_or_not() -> None:
    assert sum_of("90 - 2*(a - b)") == ({"a": -2.0, "b": 2.0}, 90.0)
    assert all(sum_of(text) is None for text in ("a*b", "a**2", "abs(a)", "import os"))
    assert convention_text({"J1": ({"a": 1.0}, 5.0, "mm")}) == "J1 = 5 + a"
    with pytest.raises(InputError, match="expected one formula a joint"):
        read_convention("J1 = a; J2 = a", gp.load_mechanism("irb6400r"), "here")
