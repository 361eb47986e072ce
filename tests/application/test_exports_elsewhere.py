"""Exports that other programs read, read as those do: each is the geometry of calibrated.urdf."""

import io
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from cli_cases import robot
from scipy.spatial.transform import Rotation
from ur_cases import ur_urdf

from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import Model
from gpmodel.application.exports.against import Check
from gpmodel.application.exports.chain import chain_of
from gpmodel.application.exports.make import as_urdf, of_urdf
from gpmodel.application.exports.rigid import Rigid, refitted
from gpmodel.application.exports.sample import Place, fresh_poses
from gpmodel.errors import InputError
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.numerics import se3
from gpmodel.table.robot_calibration import calibrated_urdf

MICROMETRE = 1e-6


@dataclass(frozen=True)
class Case:
    """A fitted arm, its geometry, and poses at which exports are compared with what `predict` gives, m."""

    model: Model
    rigid: Rigid
    check: Check
    q: np.ndarray
    points: np.ndarray

    def text(self, file: str) -> str:
        urdf = as_urdf(self.rigid, self.check)
        return urdf.text if file == urdf.file else of_urdf(file, self.rigid, urdf).text

    def missed(self, flange: np.ndarray, tool: np.ndarray | None = None) -> float:
        """Largest distance, m, of the tool point on flanges (N, 4, 4) in the root from what predict gives."""
        placed = self.model.saved.placement
        point = placed.tool[""][:3, 3] if tool is None else tool
        at = np.append(point, 1.0)
        return float(np.abs((placed.registration[""] @ flange @ at)[:, :3] - self.points).max())


@pytest.fixture(scope="module", params=["ur5e", "irb6400r"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Arms without any effect but geometry."""
    path = tmp_path_factory.mktemp("arm") / "ur5e.urdf"
    path.write_text(ur_urdf())
    name = str(path) if request.param == "ur5e" else request.param
    mechanism, made = robot(60, 3, name)
    model = calibrate(mechanism, made.dataset).model
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (20, len(mechanism.joints)))
    headers = [f"{joint.name} [rad]" for joint in mechanism.joints]
    predicted = model.predict(pd.DataFrame(q, columns=headers))[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3
    return Case(model, *geometry_of(model), q, predicted)


def geometry_of(model: Model) -> tuple[Rigid, Check]:
    place = Place.of(model.saved)
    poses = place.poses(fresh_poses(model.saved, 20, np.random.default_rng(0)))
    return refitted(model.saved), Check.against(model.saved, place, poses)


def tool_said(text: str) -> np.ndarray:
    """The tool point of the comment, m: four decimals of a millimetre."""
    found = re.search(r"# Tool point in \S+(?: \S+)*, mm: (.*)\.$", text, re.M)
    assert found is not None
    return np.array([float(v) for v in found[1].split(",")]) / 1e3


def flange_of(urdf: str, frame: str, case: Case, tmp_path: Path) -> np.ndarray:
    """The frame (N, 4, 4) in the root that a URDF text has at the poses, moved as the mechanism."""
    (tmp_path / "again.urdf").write_text(urdf)
    again = MechanismChoice(str(tmp_path / "again.urdf"), frame).load()
    own, theirs = chain_of(case.model.mechanism).motions, chain_of(again).motions
    return se3.chain(again.transforms(np.linalg.lstsq(theirs, own @ case.q.T, rcond=None)[0].T))[-1]


def with_origins(urdf: str, frames: dict[str, tuple[list[float], list[float]]]) -> str:
    """A URDF with other origins of its joints, xyz and rpy."""
    root = ET.fromstring(urdf)
    for joint in root.findall("joint"):
        if joint.get("name") in frames:
            place = joint.find("origin")
            assert place is not None
            for key, values in zip(("xyz", "rpy"), frames[joint.get("name", "")], strict=True):
                place.set(key, " ".join(map(repr, values)))
    return ET.tostring(root, encoding="unicode")


def nominal_urdf(case: Case, tmp_path: Path) -> tuple[str, str]:
    frame = case.model.mechanism.bare.write_urdf(tmp_path / "nominal.urdf", {})
    return (tmp_path / "nominal.urdf").read_text(), frame


def rows_of(text: str) -> dict[str, tuple[list[float], list[float]]]:
    content = {k: v for k, v in yaml.safe_load(text)["kinematics"].items() if k != "hash"}
    return {k: ([v["x"], v["y"], v["z"]], [v["roll"], v["pitch"], v["yaw"]]) for k, v in content.items()}


def test_origins_of_joints_go_into_a_urdf_by_name(case: Case, tmp_path: Path) -> None:
    text = case.text("exports/kinematics.yaml")
    calibrated = case.text("calibrated.urdf")
    zero = {name: ([0.0] * 3, [0.0] * 3) for name in rows_of(text)}
    blank = with_origins(calibrated, zero)
    frame = calibrated.partition("Measured link: ")[2].partition("\n")[0]
    assert f"Tool point in {frame}, mm" in text
    assert case.missed(flange_of(with_origins(blank, rows_of(text)), frame, case, tmp_path)) < MICROMETRE
    assert case.missed(flange_of(blank, frame, case, tmp_path)) > 0.1


def test_offsets_are_applied_as_robot_calibration_does(case: Case, tmp_path: Path) -> None:
    text = case.text("exports/joint_offsets.yaml")
    values = yaml.safe_load(text)
    nominal, frame = nominal_urdf(case, tmp_path)
    changed = {}
    for joint in ET.fromstring(nominal).findall("joint"):
        name, place = joint.get("name", ""), joint.find("origin")
        if f"{name}_x" in values and place is not None:
            xyz, rpy = (np.array(place.get(k, "0 0 0").split(), dtype=float) for k in ("xyz", "rpy"))
            turn = Rotation.from_euler("xyz", rpy)
            moved = xyz + turn.apply([values[f"{name}_{a}"] for a in "xyz"])
            turned = turn * Rotation.from_rotvec([values[f"{name}_{a}"] for a in "abc"])
            changed[name] = (moved.tolist(), turned.as_euler("xyz").tolist())
    assert len(changed) >= 5
    flange = flange_of(with_origins(nominal, changed), frame, case, tmp_path)
    assert case.missed(flange, tool_said(text)) < MICROMETRE
    (tmp_path / "offsets.yaml").write_text(text)
    (tmp_path / "nominal.urdf").write_text(nominal)
    again = str(calibrated_urdf(tmp_path / "offsets.yaml", tmp_path / "nominal.urdf").content)
    assert case.missed(flange_of(again, frame, case, tmp_path), tool_said(text)) < MICROMETRE


def test_ur_description_builds_the_calibrated_arm(case: Case, tmp_path: Path) -> None:
    if not case.model.mechanism.name.startswith("ur5e"):
        with pytest.raises(InputError, match="expected links shoulder_link"):
            case.text("exports/ur_kinematics.yaml")
        return
    text = case.text("exports/ur_kinematics.yaml")
    kinematics = {name: (*xyz, *rpy) for name, (xyz, rpy) in rows_of(text).items()}
    assert yaml.safe_load(text)["kinematics"]["hash"]
    flange = flange_of(ur_urdf(kinematics), "wrist_3_link", case, tmp_path)
    assert case.missed(flange, tool_said(text)) < MICROMETRE


def test_robodk_rows_move_as_the_calibrated_arm(case: Case) -> None:
    text = case.text("exports/robodk.csv")
    rows = pd.read_csv(io.StringIO(text), comment="#")
    placed = {}
    for name in ("base", "tool"):
        found = re.search(rf"# {name}, x y z r p w: (.*)", text)
        assert found is not None
        x, y, z, *rpw = map(float, found[1].split())
        placed[name] = np.eye(4)
        placed[name][:3, :3] = Rotation.from_euler("xyz", rpw, degrees=True).as_matrix()
        placed[name][:3, 3] = x, y, z
    names = {joint.name: case.q[:, i] for i, joint in enumerate(case.model.mechanism.joints)}
    flange = np.repeat(placed["base"][None], len(case.q), axis=0)
    for row in rows.itertuples(index=False):
        motion, rx, tx, tz, rz = row
        terms = re.findall(r"([+-][\d.e]+)\*(\w+)", motion)
        turn = np.radians(rz) + sum(float(weight) * names[name] for weight, name in terms)
        step = np.repeat(np.eye(4)[None], len(case.q), axis=0)
        step[:, :3, :3] = (
            Rotation.from_euler("x", np.radians(rx)) * Rotation.from_euler("z", turn[:, None])
        ).as_matrix()
        step[:, :3, 3] = Rotation.from_euler("x", np.radians(rx)).apply([tx, 0.0, tz])
        flange = flange @ step
    flange = flange @ placed["tool"]
    flange[:, :3, 3] /= 1e3
    assert case.missed(flange) < MICROMETRE


def test_what_a_geometry_cannot_hold_is_said_in_every_file(case: Case) -> None:
    rigid = replace(case.rigid, missing=("joint compliance, J2",))
    urdf = as_urdf(rigid, case.check)
    for file in ("kinematics.yaml", "joint_offsets.yaml", "robodk.csv"):
        export = of_urdf(f"exports/{file}", rigid, urdf)
        assert export.missing == ("joint compliance, J2",)
        assert "# Missing: joint compliance, J2." in export.text
