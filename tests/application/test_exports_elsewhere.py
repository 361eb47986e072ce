"""Test that every exported file, read like other programs do, gives the predictions of the model."""

import csv
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace

import numpy as np
import pytest
import yaml
from cli_cases import robot
from robots_cases import ODD_URDF
from scipy.spatial.transform import Rotation
from ur_cases import ur_urdf

from experiments.exports.run import pinocchio_frames
from gpmodel.api.calibrate import calibrate
from gpmodel.application.exports.dh import across, dh_text
from gpmodel.application.exports.forward import chain_of
from gpmodel.application.exports.make import DH, OF_URDF, Check, Export, PredictedPoints, as_urdf, of_urdf
from gpmodel.application.exports.reading import points_read
from gpmodel.application.exports.rigid import URDF, Rigid, note_of, refitted, written
from gpmodel.application.exports.sample import Place, fresh_poses
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.numerics import se3

MICROMETRE = 1e-6
WRIST = """
convention = "modified"
[tool]
xyz_mm = [20, 0, 60]
"""
WRIST += "".join(
    f"[[joint]]\nalpha_deg = {alpha}\na_mm = {a}\nd_mm = {d}\nlower_deg = -150\nupper_deg = 150\nsign = {sign}\n"
    for alpha, a, d, sign in [(0, 0, 500, 1), (-90, 100, 0, 1), (5, 600, 0, -1), (-90, 90, 700, 1), (90, 0, 0, 1),
                              (-90, 0, 90, -1)]
)  # fmt: skip
WRIST += "".join(
    f'[[coupling]]\njoint = "{joint}"\nfollows = "{follows}"\nfactor = {factor}\n'
    for joint, follows, factor in [("J5", "J4", 0.02), ("J6", "J4", -0.01), ("J6", "J5", 1.0)]
)
"""A wrist whose last two joints are turned by those before them, and a joint that counts the other way."""
SWING, LIMIT = '<axis xyz="1 2 3"/>', '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
MADE = {
    "ur5e.urdf": ur_urdf(),
    "odd.urdf": ODD_URDF.replace('"continuous"', '"revolute"').replace(SWING, f"{SWING}{LIMIT}"),
    "wrist.toml": WRIST,
}
REFUSED = {
    ("irb6400r", "exports/robodk.csv"): "J3 also moves with J2; expected joints that move independently",
    ("wrist.toml", "exports/robodk.csv"): "J5 also moves with J4",
    ("odd.urdf", "exports/robodk.csv"): "expected one motion per joint",
    ("odd.urdf", "exports/dh_modified.toml"): "expected one motion per joint",
    ("odd.urdf", "exports/dh_standard.toml"): "expected one motion per joint",
    ("ur5e.urdf", "exports/robodk.csv"): (
        "deg from parallel, which puts their common normal beyond 10 m; expected a nearer"
    ),
}
REFUSED |= dict.fromkeys(
    [(arm, "exports/ur_kinematics.yaml") for arm in ("irb6400r", "wrist.toml", "odd.urdf", "panda")],
    "expected links shoulder_link",
)
"""What a format cannot hold."""
FOLLOWING = {
    "irb6400r": ("J3 here = J3 of the controller - J2",),
    "wrist.toml": ("J5 here = J5 of the controller + 0.02 J4", "J6 here = J6 of the controller + 0.01 J4 - J5"),
}
"""Lines in the head of every file without [[coupling]]."""


@dataclass(frozen=True)
class Case:
    """A fitted arm, its geometry, and what predict gives."""

    name: str
    rigid: Rigid
    predicted: PredictedPoints

    def export(self, file: str) -> Export:
        urdf = as_urdf(self.rigid, self.predicted)
        if file in DH:
            mechanism = self.rigid.mechanism
            text = dh_text(mechanism, chain_of(mechanism), self.rigid.twists, DH[file], note_of(self.rigid, file))
            return replace(urdf, text=text)
        return urdf if file == URDF else of_urdf(file, self.rigid, urdf.text, self.predicted)

    def missed(self, flange: np.ndarray, text: str) -> float:
        """Largest distance, m, of the stated tool point on flanges (N, 4, 4) in the root from what predict gives."""
        at = registration_said(text) @ flange @ np.append(tool_said(text)[1], 1.0)
        return float(np.linalg.norm(at[:, :3] - self.predicted.points, axis=1).max())


@pytest.fixture(
    scope="module",
    params=["irb6400r", "ur5e.urdf", "wrist.toml"]
    + [pytest.param(p, marks=pytest.mark.long) for p in ("panda", "odd.urdf")],
)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Arms without any effect but geometry."""
    path = tmp_path_factory.mktemp("arm") / request.param
    if request.param in MADE:
        path.write_text(MADE[request.param])
    mechanism, made = robot(40, 3, str(path) if request.param in MADE else request.param)
    saved = calibrate(mechanism, made.dataset).model.saved
    place = Place.of(saved)
    poses = place.poses(fresh_poses(saved, 20, np.random.default_rng(0)))
    return Case(request.param, refitted(saved), Check.against(saved, place, poses).predicted)


def tool_said(text: str) -> tuple[str, np.ndarray]:
    """The link and the tool point, m, of the comment."""
    found = re.search(r"Tool point in (\S+(?: \S+)*), mm: (.*)\.$", text, re.M)
    assert found is not None
    return found[1], np.array([float(v) for v in found[2].split(",")]) / 1e3


def registration_said(text: str) -> np.ndarray:
    """The pose (4, 4) of the root in the frame of the instrument of the comment, m."""
    found = re.search(r"Root in the frame of the instrument: xyz mm (.*); rpy rad (.*)\.$", text, re.M)
    assert found is not None
    place, turn = (np.array([float(v) for v in part.split(",")]) for part in found.groups())
    return se3.frame(Rotation.from_euler("xyz", turn).as_matrix(), place / 1e3)


def with_origins(urdf: str, frames: dict[str, tuple[list[float], list[float]]]) -> str:
    """A URDF with other origins of its joints, xyz and rpy."""
    root = ET.fromstring(urdf)
    for joint in root.findall("joint"):
        if (name := joint.get("name", "")) in frames:
            place = joint.find("origin")
            place = ET.SubElement(joint, "origin") if place is None else place
            for key, values in zip(("xyz", "rpy"), frames[name], strict=True):
                place.set(key, " ".join(map(repr, values)))
    return ET.tostring(root, encoding="unicode")


def rows_of(text: str) -> dict[str, tuple[list[float], list[float]]]:
    content = {k: v for k, v in yaml.safe_load(text)["kinematics"].items() if k != "hash"}
    return {k: ([v["x"], v["y"], v["z"]], [v["roll"], v["pitch"], v["yaw"]]) for k, v in content.items()}


def offset_origins(nominal: str, text: str) -> dict[str, tuple[list[float], list[float]]]:
    """Origins with robot_calibration's offsets, as its updateURDF makes them."""
    values, changed = yaml.safe_load(text), {}
    for joint in ET.fromstring(nominal).findall("joint"):
        name, place = joint.get("name", ""), joint.find("origin")
        if f"{name}_x" in values:
            found = {} if place is None else place.attrib
            xyz, rpy = (np.array(found.get(k, "0 0 0").split(), dtype=float) for k in ("xyz", "rpy"))
            turn = Rotation.from_euler("xyz", rpy)
            moved = xyz + turn.apply([values[f"{name}_{a}"] for a in "xyz"])
            turned = turn * Rotation.from_rotvec([values[f"{name}_{a}"] for a in "abc"])
            changed[name] = (moved.tolist(), turned.as_euler("xyz").tolist())
    return changed


def robodk_frames(text: str, case: Case) -> np.ndarray:
    placed = {}
    for name in ("base", "tool"):
        x, y, z, *rpw = map(float, text.partition(f"# {name}, x y z r p w: ")[2].partition("\n")[0].split())
        placed[name] = se3.frame(Rotation.from_euler("xyz", rpw, degrees=True).as_matrix(), [x, y, z])
    values = dict(zip(case.predicted.dataset.joints, case.predicted.dataset.q.T, strict=True))
    flange = np.repeat(placed["base"][None], len(case.predicted.points), axis=0)
    for joint, kind, sense, *numbers in list(csv.reader(re.sub("#.*\n", "", text).splitlines()))[1:]:
        rx, tx, tz, rz = map(float, numbers)
        assert kind == "revolute"
        turn = np.radians(rz) + int(sense) * values[joint]
        for part in (Rotation.from_euler("x", rx, degrees=True), None, Rotation.from_euler("z", turn[:, None])):
            step = np.eye(4) if part is None else np.zeros((len(turn), 4, 4)) + np.eye(4)
            if part is None:
                step[:3, 3] = tx, 0.0, tz
            else:
                step[:, :3, :3] = part.as_matrix()
            flange = flange @ step
    flange = flange @ placed["tool"]
    flange[:, :3, 3] /= 1e3
    return flange


def read_elsewhere(case: Case, file: str, text: str) -> float:
    """Return the distance of a file's tool from the prediction, by readers outside the product, m."""
    link = tool_said(text)[0]
    nominal = written(case.rigid.mechanism, {})[0]
    if file in DH:
        path = MechanismChoice("rows.toml", description=text).load()
        return case.missed(se3.chain(path.transforms(case.predicted.dataset.q))[-1], text)
    if file == "exports/robodk.csv":
        return case.missed(robodk_frames(text, case), text)
    if file == URDF:
        link = text.partition("Measured link: ")[2].partition("\n")[0]
        return case.missed(pinocchio_frames(text, link, case.predicted.dataset), text)
    if file == "exports/ur_kinematics.yaml":
        assert yaml.safe_load(text)["kinematics"]["hash"]
        urdf = ur_urdf({name: (*xyz, *rpy) for name, (xyz, rpy) in rows_of(text).items()})
        return case.missed(pinocchio_frames(urdf, link, case.predicted.dataset), text)
    rows = rows_of(text) if file == "exports/kinematics.yaml" else offset_origins(nominal, text)
    assert len(rows) >= 3
    return case.missed(pinocchio_frames(with_origins(nominal, rows), link, case.predicted.dataset), text)


@pytest.mark.parametrize("file", [URDF, *DH, *OF_URDF])
def test_every_file_is_predict_where_others_read_it_or_is_refused(case: Case, file: str) -> None:
    if (case.name, file) in REFUSED:
        with pytest.raises(InputError, match=re.escape(REFUSED[case.name, file])):
            case.export(file)
        return
    export = case.export(file)
    assert read_elsewhere(case, file, export.text) < MICROMETRE
    assert export.largest < MICROMETRE
    for said in FOLLOWING.get(case.name, ()):
        assert said in export.text or file in DH


def test_values_of_another_joint_are_seen(case: Case) -> None:
    text, data = case.export(URDF).text, case.predicted.dataset
    wrong = replace(data, q=np.roll(data.q, 1, axis=1))
    assert case.predicted.errors(points_read(URDF, text, case.rigid, wrong))[1] > 0.05
    if case.name in FOLLOWING:
        with pytest.raises(KeyError, match="_with_"):
            points_read(URDF, re.sub("<mimic[^>]*>", "", text), case.rigid, data)


def test_what_a_geometry_cannot_hold_is_said_in_every_file(case: Case) -> None:
    lacking = replace(case, rigid=replace(case.rigid, missing=("joint compliance, J2",)))
    for file in (URDF, "exports/kinematics.yaml", "exports/joint_offsets.yaml"):
        export = lacking.export(file)
        assert export.missing == ("joint compliance, J2",)
        assert "Missing: joint compliance, J2." in export.text


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 1e-3, 0.3, 1.2, 5.0, 179.9])
def test_rows_go_across_axes_at_any_tilt_without_a_far_normal(degrees: float) -> None:
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_euler("yx", [degrees, 0.2], degrees=True).as_matrix()
    frame[:3, 3] = 1.0, 0.1, 0.3
    row = across(frame)
    assert max(abs(row.slide), abs(row.next_slide)) < 12.0
    parts = [("Rz", row.turn), ("Tz", row.slide), ("Rx", row.alpha), ("Tx", row.a), ("Ry", row.beta)]
    made = np.eye(4)
    for axis, value in [*parts, ("Rz", row.next_turn), ("Tz", row.next_slide)]:
        twist = np.zeros(6)
        twist[AXES.index(axis)] = value
        made = made @ se3.exp(twist)
    np.testing.assert_allclose(made, frame, atol=1e-12)
