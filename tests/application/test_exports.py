"""Test that every exported file, read back, is the model or states its error."""

import io
import re
import types
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run
from exports_cases import fitted, fresh, points
from instances import some
from latex_reading import read_latex
from scipy.interpolate import RegularGridInterpolator

import gpmodel as gp
from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import Model
from gpmodel.application.exports import make
from gpmodel.application.exports.dh import Convention, dh_text
from gpmodel.application.exports.forward import chain_of, forward_of
from gpmodel.application.exports.make import Exports, exports_of
from gpmodel.application.exports.rigid import refitted
from gpmodel.application.exports.sample import Place
from gpmodel.application.exports.sources import numpy_text
from gpmodel.application.kinematics import solve, tips
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import usable, without_instrument
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import AXES
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import prepare
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset
from gpmodel.table.read import dataset_from
from joints.hexapod import hexapod

EFFECTS = {
    "irb6400r": ("base_compliance=3e-7", "gear_harmonic J4=60 arcsec", "J3.moving:Ry:max(J2, 0)*sin(2*J3)=0.3 mrad"),
    "ur5": ("J1.moving:Rx:torque_shoulder_lift_joint_of_elbow_joint_x=0.02 mrad", "joint_compliance elbow_joint=3e-6"),
    "panda": ("base:Ry:moment_base_x_of_panda_joint4_y=0.02 mrad", "J2.moving:Tz:step(x)*abs(y)=0.4 mm"),
}
FILES = {
    "calibrated.urdf", "exports/dh_modified.toml", "exports/dh_standard.toml", "exports/model.py", "exports/model.c",
    "exports/model.h", "exports/model.tex", "exports/grid.csv", "exports/kinematics.yaml", "exports/joint_offsets.yaml",
}  # fmt: skip
REFUSED = {"exports/ur_kinematics.yaml", "exports/robodk.csv"}
"""Exports that not every arm allows: links unlike UR's, axes nearly parallel."""


@pytest.fixture(scope="module", params=some(EFFECTS, "irb6400r", "ur5"))
def model(request: pytest.FixtureRequest) -> Model:
    return fitted(request.param, EFFECTS[request.param])


@pytest.fixture(scope="module")
def exports(model: Model) -> Exports:
    return exports_of(model.saved, Place.of(model.saved))


@pytest.mark.first(1)
def test_everything_is_made_and_says_its_error(exports: Exports) -> None:
    assert {e.file for e in exports.files} - REFUSED == FILES
    assert set(exports.refused) == REFUSED - {e.file for e in exports.files}
    assert "exports/ur_kinematics.yaml" in exports.refused
    known = {e.file: (e.rms, e.largest) for e in exports.files}
    assert known["exports/model.py"][1] < 1e-10
    assert np.isfinite([known[f][0] for f in FILES - {"exports/model.c", "exports/model.h"}]).all()


@pytest.mark.long
def test_parts_that_run_at_the_same_time_compare_at_the_same_poses(
    model: Model, exports: Exports, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of two threads may find that the poses are not drawn yet."""
    both, draw = Barrier(2), make.fresh_poses

    def together_drawn(*given: Any) -> Dataset:
        both.wait(30.0)
        return draw(*given)

    monkeypatch.setattr(make, "fresh_poses", together_drawn)
    parts = make.parts_of(model.saved, Place.of(model.saved))
    with ThreadPoolExecutor(2) as pool:
        source, latex = pool.map(lambda part: part(), parts[1:3])
    known = {export.file: export for export in exports.files}
    for export in (*source.files, *latex.files):
        assert export.text == known[export.file].text


@pytest.mark.long
def test_a_session_is_a_number_in_exports_and_what_reads_it_with_the_pose_is_missing() -> None:
    effects = ("J1.moving:Rz:0.01*row=2e-4", "J4.moving:Ry:0.01*row*sin(J5)=2e-4")
    mechanism, made = robot(80, 3, "irb6400r", effects=effects)
    texts = [text.rpartition("=")[0] for text in effects]
    for count, largest in ((1, 1e-10), (2, 1e-3)):
        saved = calibrate(mechanism, made.dataset, texts[:count]).model.saved
        source = next(e for e in exports_of(saved, Place.of(saved)).files if e.file == "exports/model.py")
        assert len(source.missing) == count - 1
        assert (source.largest < 1e-10) == (count == 1)
        assert source.largest < largest


@pytest.mark.long
@pytest.mark.parametrize("by", some(["a fit", "export"], "export"))
def test_no_file_of_an_earlier_model_is_left_among_the_exports(by: str, tmp_path: Path) -> None:
    mechanism, made = robot(30, name="irb6400r")
    old = tmp_path / "exports" / "ur_kinematics.yaml"
    old.parent.mkdir()
    old.write_text("kinematics: {}")
    fit = calibrate(mechanism, made.dataset)
    fit.report(tmp_path) if by == "a fit" else fit.model.export().report(tmp_path)
    assert (tmp_path / "exports" / "model.py").exists()
    assert not old.exists()


def test_the_numpy_source_is_the_model(model: Model, exports: Exports) -> None:
    text = next(e.text for e in exports.files if e.file == "exports/model.py")
    module = types.ModuleType("exported")
    exec(text, module.__dict__)
    q = fresh(model)
    np.testing.assert_allclose(module.predict(q), points(model, q), atol=1e-11)


def test_the_numpy_source_assumes_no_input_that_predict_needs() -> None:
    columns = {"temperature [degC]": "18:25", "payload [kg]": "0|30|60"}
    made, names = gp.simulate("irb6400r", poses=50, inputs=columns), ("joint_compliance J2", "J3.moving:Rz:temperature")
    model = calibrate(gp.load_mechanism("irb6400r"), made.table, names).model
    forward = forward_of(model.saved, Place.of(model.saved))
    module, given = types.ModuleType("exported"), {"temperature": 20.0, "payload": 30.0}
    exec(numpy_text(forward, ""), module.__dict__)
    assert module.INPUTS == {"temperature": "degC", "payload": "kg"}
    assert np.isfinite(module.predict(made.table.q, **given)).all()
    for wrong in ({"temperature": 20.0}, {"payload": 30.0}, {**given, "temp": 20.0}):
        with pytest.raises(TypeError, match=r"expected \['payload', 'temperature'\]"):
            module.predict(made.table.q, **wrong)


ROW = re.compile(r"\\xi_\{\\mathrm\{(?P<slot>[^{}]*)\},\\,(?P<axis>\w+)\} &= (?P<text>.*)")


def test_the_latex_read_back_is_the_model_to_its_digits(model: Model, exports: Exports) -> None:
    export = next(e for e in exports.files if e.file == "exports/model.tex")
    rows = [line.removesuffix(" \\\\") for line in export.text.splitlines()[1:-1]]
    found = [match for match in map(ROW.match, rows) if match]
    assert len(found) == len(rows)
    chain, q = chain_of(model.mechanism), fresh(model)
    degrees = pd.DataFrame({f"{j.name} [deg]": np.degrees(v) for j, v in zip(model.mechanism.joints, q.T, strict=True)})
    states = prepare(model.mechanism, at_joints(model.saved, degrees)).states
    twists = np.zeros((len(chain.slots), len(q), 6))
    for match in found:
        slot, axis = match["slot"].replace("\\_", "_"), AXES.index(match["axis"])
        twists[chain.slots.index(slot), :, axis] = Expression(read_latex(match["text"]))(states)
    frames = np.array([fixed @ se3.exp(t) for fixed, t in zip(chain.transforms(q), twists, strict=True)])
    placed = model.saved.placement
    read = (placed.registration[""] @ se3.chain(frames)[-1] @ placed.tool[""])[:, :3, 3]
    off = np.linalg.norm(read - points(model, q), axis=1)
    assert 1e-12 < np.median(off) < 1e-7
    assert off.max() < 3 * export.largest


def test_the_c_source_compiles_and_is_the_model(exports: Exports) -> None:
    text = next(e.text for e in exports.files if e.file == "exports/model.c")
    found = make.tested(text)
    assert np.isnan(found["RMS"]) or found["RMS"] <= found["largest"] < 1e-10
    assert np.isnan(found["miss"]) or found["miss"] < 1e-8
    assert [line for line in text.splitlines() if line.startswith("#include")] == [
        "#include <math.h>", "#include <stdio.h>", "#include <time.h>",
    ]  # fmt: skip


def test_the_rigid_exports_are_one_refitted_geometry_and_name_what_is_missing(
    model: Model, exports: Exports, tmp_path: Path
) -> None:
    made = {e.file: e for e in exports.files}
    rigid = [made[f] for f in ("calibrated.urdf", "exports/dh_modified.toml", "exports/dh_standard.toml")]
    varying = {e.name for e in model.saved.model.effects if not e.constant}
    assert all(set(e.missing) == varying for e in rigid)
    assert len({round(e.rms, 9) for e in rigid}) == 1
    assert all(f"{1e3 * e.heldout:.3f} mm RMS" in e.text for e in rigid)
    kept = tuple(np.where([e.constant for e in model.saved.model.effects], model.saved.theta, 0.0))
    saved = model.saved
    dropped = Model(SavedModel(saved.model, np.array(kept), saved.stderr, saved.covariance, saved.placement,
                               saved.weights, saved.sigma, saved.pose, {}))  # fmt: skip
    q = fresh(model, 300)
    off = np.linalg.norm(points(dropped, q) - points(model, q), axis=1)
    assert rigid[0].rms < np.sqrt(np.mean(off**2))
    (tmp_path / "dh.toml").write_text(rigid[1].text)
    again = MechanismChoice(str(tmp_path / "dh.toml")).load()
    assert [j.name for j in again.joints] == [j.name for j in model.mechanism.joints]


@pytest.mark.long
@pytest.mark.parametrize("poses", [60, 160])
def test_outliers_do_not_count_in_the_held_out_error_of_a_refitted_geometry(poses: int) -> None:
    """Of 60 poses each is held out once, of 160 three tenths."""
    mechanism, made = robot(poses, 3, effects=("base_compliance=3e-8",))
    rms = []
    for gross in (0.0, 5e-3):
        position = made.dataset.position.copy()
        position[[7, 20, 50], [0, 1, 2]] += gross
        fit = calibrate(mechanism, replace(made.dataset, position=position), ["base_compliance"])
        assert fit.record.data.outliers == ((8, 21, 51) if gross else ())
        rms.append(root_mean_square(refitted(fit.model.saved).heldout))
    assert rms[1] == pytest.approx(rms[0], rel=0.1)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("name", ["irb6400r", "ur10_limited", "panda", "kinova", "xarm7"])
def test_rows_are_read_back_as_the_chain_they_were_made_of(name: str, convention: Convention, tmp_path: Path) -> None:
    mechanism, rng = MechanismChoice(name).load(), np.random.default_rng(1)
    chain = chain_of(mechanism)
    twists = {slot: rng.normal(0.0, 1e-3, 6) for slot in chain.slots}
    (tmp_path / "dh.toml").write_text(dh_text(mechanism, chain, twists, convention, "as made"))
    q = random_poses(mechanism, 20, rng)
    frames = mechanism.transforms(q) @ se3.exp(np.array([twists[s] for s in chain.slots]))[:, None]
    again = MechanismChoice(str(tmp_path / "dh.toml")).load()
    np.testing.assert_allclose(se3.chain(again.transforms(q))[-1], se3.chain(frames)[-1], atol=1e-12)


def test_the_grid_is_read_back_and_its_corrections_reach_its_nodes(model: Model, exports: Exports) -> None:
    grid = pd.read_csv(io.StringIO(next(e.text for e in exports.files if e.file == "exports/grid.csv")))
    sides = [np.unique(grid[f"{a} [mm]"]) for a in "xyz"]
    assert [len(side) for side in sides] == [5, 5, 5]
    joints = [f"{j.name} [deg]" for j in model.mechanism.joints]
    assert grid.notna().all(axis=None)
    real = points_in_root(without_instrument(usable(model.saved)), grid, joints)
    wanted = grid[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3
    np.testing.assert_allclose(real, wanted, atol=1e-6)


def test_a_controller_that_interpolates_in_the_grid_misses_by_what_is_said(model: Model, exports: Exports) -> None:
    export = next(e for e in exports.files if e.file == "exports/grid.csv")
    measured = model.saved.measured
    assert measured is not None
    stated = measured.dataset.payload_given or bool(model.saved.input_units)
    assert len(export.notes) == 1 + stated
    grid = pd.read_csv(io.StringIO(export.text))
    sides = [np.unique(grid[f"{a} [mm]"]) for a in "xyz"]
    between = RegularGridInterpolator(sides, grid.to_numpy().reshape(5, 5, 5, -1))
    low, high = np.array([(side[0], side[-1]) for side in sides]).T
    fresh = pd.DataFrame(between(np.random.default_rng(3).uniform(low, high, (150, 3))), columns=grid.columns)
    joints, saved = [f"{j.name} [deg]" for j in model.mechanism.joints], without_instrument(usable(model.saved))
    nominal_tip = tips(saved, at_joints(saved, grid[joints]), nominal=True)[1].tip[0]
    frames = np.repeat(nominal_tip[None], len(fresh), axis=0)
    frames[:, :3, 3] = fresh[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3
    start, left = solve(saved, at_joints(saved, fresh[joints]), frames, True, nominal=True)
    assert left.max() < 1e-6
    fresh[joints] = np.degrees(start)
    off = np.linalg.norm(points_in_root(saved, fresh, joints) - frames[:, :3, 3], axis=1)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(export.rms, rel=0.4)
    assert off.max() < 2 * export.largest


def points_in_root(saved: SavedModel, grid: pd.DataFrame, joints: list[str]) -> np.ndarray:
    """Where the real tool is at the nodes' corrected joint values, m."""
    corrected = pd.DataFrame({name: grid[name] + grid[f"delta_{name}"] for name in joints})
    return tips(saved, at_joints(saved, corrected), nominal=False)[1].tip[:, :3, 3]


def at_joints(saved: SavedModel, degrees: pd.DataFrame) -> Dataset:
    return dataset_from(degrees.map(str), Path("grid"), saved.mechanism, need_measurement=False)


@pytest.mark.long
def test_of_several_set_ups_and_tools_the_named_ones_are_exported_and_said(tmp_path: Path) -> None:
    mechanism, made = robot(80, 3, "irb6400r", effects=("joint_compliance J2=2e-7",))
    half = np.arange(80) % 2 == 0
    moved = np.where(half[:, None], made.dataset.position, made.dataset.position + np.array([0.5, 0.2, 0.1]))
    labels = {"setup": np.where(half, "east", "west"), "tool": np.where(half, "ball", "cup")}
    table = replace(made.dataset, position=moved, labels=labels)
    model = calibrate(mechanism, table, ["joint_compliance J2"]).model
    model.save(tmp_path / "model.json")
    q = fresh(model)
    for options, setup, tool in (((), "east", "ball"), (("--setup", "west", "--tool", "cup"), "west", "cup")):
        done = run("export", tmp_path, *options)
        assert done.exit_code == 0, done.stderr
        frame = pd.DataFrame({f"{j.name} [rad]": v for j, v in zip(mechanism.joints, q.T, strict=True)})
        wanted = model.predict(frame.assign(setup=setup, tool=tool))[["x [mm]", "y [mm]", "z [mm]"]] / 1e3
        text = (tmp_path / "exports" / "model.py").read_text()
        assert f"Set-up {setup}, one of east, west. Tool {tool}, one of ball, cup." in text
        module = types.ModuleType("exported")
        exec(text, module.__dict__)
        np.testing.assert_allclose(module.predict(q), wanted, atol=1e-11)
        assert make.tested((tmp_path / "exports" / "model.c").read_text())["largest"] < 1e-10
    assert "--tool" in one_line(run("export", tmp_path, "--tool", "hook"), 2)


@pytest.mark.long
def test_the_command_writes_what_it_says(tmp_path: Path) -> None:
    fitted("ur5", EFFECTS["ur5"]).save(tmp_path / "model.json")
    done = run("export", tmp_path, "--box", "0:150,300:450,250:400mm", "--nodes", 3)
    assert done.exit_code == 0, done.stderr
    assert {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.*")} == FILES | {"model.json"}
    assert "not in calibrated.urdf" in done.stdout
    assert len(pd.read_csv(tmp_path / "exports" / "grid.csv")) == 27
    assert "--box" in one_line(run("export", tmp_path, "--box", "0:1,2:3mm"), 2)
    assert "--box" in one_line(run("export", tmp_path, "--box", "9:10,9:10,9:10m"), 2)


@pytest.mark.long
def test_the_exported_urdf_of_an_arm_with_a_parallel_bar_fits_its_own_table(tmp_path: Path) -> None:
    options = ("--mechanism", "irb6400r", "--noise", "0.05mm", "--geometry-sigma", "0.3mm", "--poses", 90)
    assert run("simulate", *options, "--out", tmp_path / "t.csv").exit_code == 0
    done = run("calibrate", tmp_path / "t.csv", *options[:2], "--out", tmp_path / "result")
    assert done.exit_code == 0, done.stderr
    said = run("check", tmp_path / "t.csv", "--mechanism", tmp_path / "result" / "calibrated.urdf").stdout
    left = re.search(r"residual of the fitted poses: registration and tool ([\d.]+) mm RMS", said)
    assert left is not None
    assert float(left[1]) < 0.11


def test_closed_loops_are_the_reason_why_no_text_holds_a_hexapod() -> None:
    with pytest.raises(InputError, match="has closed loops; expected a serial chain"):
        chain_of(hexapod())
