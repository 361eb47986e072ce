"""Read exported files of the refitted geometry as other programs do, from the text and the controller's joint values.

    p = T_registration T_link(q) p_tool,   T_link and p_tool from the text

URDF and DH rows are read by the mechanism loaders, robot_calibration's offsets by the importer, and YAML and RoboDK's
table by the functions of this module. The readers of exported files share no code with the writers.
"""

import csv
import json
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.application.exports.rigid import Rigid, measured_link, written
from gpmodel.arrays import Array
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset
from gpmodel.table.of_programs import calibrated_urdf

Origins = dict[str, tuple[float, ...]]
"""Origins of joints: x, y, z, m, and roll, pitch, yaw, rad, by the name of a row."""
_TOOL = re.compile(r"Tool point.* in (?P<link>.*), mm: (?P<point>.*)\.$", re.M)


def points_read(file: str, text: str, rigid: Rigid, dataset: Dataset) -> Array:
    """Compute tool points in the instrument's frame, m, from an exported file at the joint values of a dataset.

    rigid: refitted geometry, of which only registration, tool names and nominal mechanism are used.
    """
    said = dict(zip(rigid.placement.tool, _TOOL.finditer(text), strict=True))
    setups, tools, tips = (dataset.label(name).tolist() for name in ("setup", "tool", "tip"))
    order = list(getattr(branched(rigid.mechanism), "tips", ()))
    points = np.empty((len(dataset), 3))
    for place in {*zip(setups, tools, tips, strict=True)}:
        setup, tool, tip = place
        rows = np.array([row == place for row in zip(setups, tools, tips, strict=True)])
        links = (measured_link(text) or said[tool]["link"]).split(",")
        link = links[order.index(tip)] if len(links) > 1 and tip else links[0]
        point = np.array([float(v) for v in said[tool]["point"].split(",")]) / 1e3
        q = dict(zip(dataset.joints, dataset.q[rows].T, strict=True))
        at = rigid.placement.registration[setup] @ _frames(file, text, link, rigid, q)
        points[rows] = at[:, :3, :3] @ point + at[:, :3, 3]
    return points


def _frames(file: str, text: str, link: str, rigid: Rigid, q: Mapping[str, Array]) -> Array:
    """Compute the frame of a link in the root frame, m, at joint values q, from an exported file."""
    suffix, nominal = Path(file).suffix, written(rigid.mechanism, {})[0] if file.endswith(".yaml") else ""
    match Path(file).name:
        case "robodk.csv":
            return _robodk(text, q)
        case "joint_offsets.yaml":
            text, suffix = _with_offsets(nominal, text), ".urdf"
        case "kinematics.yaml":
            text, suffix = _with_origins(nominal, _origins(text)), ".urdf"
        case "ur_kinematics.yaml":
            text, suffix = _with_origins(nominal, _origins(text), ur=True), ".urdf"
    mechanism = MechanismChoice(f"read{suffix}", link if suffix == ".urdf" else None, description=text).load()
    values = np.column_stack([q[joint.name] for joint in mechanism.joints])
    return np.asarray(se3.chain(mechanism.transforms(values))[-1])


def _with_offsets(nominal: str, text: str) -> str:
    """Return a nominal URDF with robot_calibration's offsets applied; unchanged without offsets."""
    if not re.search(r"^[^#\n]", text, re.M):
        return nominal
    with tempfile.TemporaryDirectory() as folder:
        urdf, offsets = Path(folder) / "nominal.urdf", Path(folder) / "joint_offsets.yaml"
        urdf.write_text(nominal, encoding="utf-8")
        offsets.write_text(text, encoding="utf-8")
        return str(calibrated_urdf(offsets, urdf).content)


def _origins(text: str) -> Origins:
    """Read the rows of a YAML file of joint origins, with one number per line below the name of the row."""
    rows: dict[str, list[float]] = {}
    for name, value in re.findall(r"^ +(.+?): *([-+.\deE]*)$", text, re.M):
        if not value:
            numbers = rows[json.loads(name) if name.startswith('"') else name] = []
        else:
            numbers.append(float(value))
    return {name: tuple(values) for name, values in rows.items()}


def _with_origins(nominal: str, rows: Origins, *, ur: bool = False) -> str:
    """Return a nominal URDF with replaced joint origins. ur: True if rows are named by UR's links, else by joints."""
    robot = ET.fromstring(nominal)
    for joint in robot.findall("joint"):
        child = "" if (link := joint.find("child")) is None else link.get("link", "")
        key = next((name for name in rows if child.endswith(f"{name}_link")), "") if ur else joint.get("name", "")
        if key in rows and not (ur and joint.get("type") == "fixed"):
            origin = joint.find("origin")
            origin = ET.SubElement(joint, "origin") if origin is None else origin
            origin.set("xyz", " ".join(map(repr, rows[key][:3])))
            origin.set("rpy", " ".join(map(repr, rows[key][3:])))
    return ET.tostring(robot, encoding="unicode")


def _robodk(text: str, q: Mapping[str, Array]) -> Array:
    """Return the last frame of RoboDK's table, m: base, then rotx(rx) transl(tx, 0, tz) rotz(rz) per row, then
    tool."""
    placed = {}
    for name in ("base", "tool"):
        numbers = [float(v) for v in text.partition(f"# {name}, x y z r p w: ")[2].partition("\n")[0].split()]
        placed[name] = se3.frame(Rotation.from_euler("xyz", numbers[3:], degrees=True).as_matrix(), numbers[:3])
    frames = np.repeat(placed["base"][None], len(next(iter(q.values()))), axis=0)
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        rx, tx, tz, rz = (float(row[column]) for column in ("rx [deg]", "tx [mm]", "tz [mm]", "rz [deg]"))
        moved, slides = float(row["sense"]) * q[row["joint"]], float(row["kind"] == "prismatic")
        about = Rotation.from_euler("x", rx, degrees=True)
        step = np.repeat(np.eye(4)[None], len(frames), axis=0)
        turn = np.radians(rz) + (1.0 - slides) * moved
        step[:, :3, :3] = (about * Rotation.from_euler("z", turn[:, None])).as_matrix()
        along = np.tile([tx, 0.0, tz], (len(frames), 1))
        along[:, 2] += slides * 1e3 * moved
        step[:, :3, 3] = about.apply(along)
        frames = frames @ step
    frames = frames @ placed["tool"]
    frames[:, :3, 3] /= 1e3
    return np.asarray(frames)
