"""Import of files of other calibration programs: UR, robot_calibration, OpenCV, ROS, FIGAROH."""

import json
import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import LARGEST, Mechanism
from gpmodel.mechanism.source import LARGEST_FILE
from gpmodel.numerics import se3
from gpmodel.table.cells import numbers, read_frame
from gpmodel.table.dataset import LABELS
from gpmodel.table.foreign import ColumnMap, Imported, OrientationColumns, cells, left_out
from gpmodel.table.units import JOINT_UNITS, split_header
from gpmodel.texts import read_text

OFFSETS = "robot_calibration's offsets, a line `NAME: number` each, of at most 1000 m or rad"


def calibrated_urdf(path: Path, nominal: Path) -> Imported:
    """Return the nominal URDF with the offsets of robot_calibration applied.

    origin' = origin · X · M(o)

    X: transform of the offsets NAME_x, NAME_y, NAME_z, m, and NAME_a, NAME_b, NAME_c, a rotation vector, rad.
    M(o): motion of the joint NAME by its offset o, rad or m.
    Raises InputError if a file is unreadable, or no offset belongs to a joint of the URDF.
    Source: mikeferguson/robot_calibration, optimization/offsets.cpp, getOffsetYAML and updateURDF. updateURDF writes a
    joint's offset to <calibration rising>, which no other program reads.
    """
    offsets = _offsets(path)
    try:
        robot = ET.fromstring(read_text(nominal, LARGEST_FILE, "a URDF file"))
    except ET.ParseError as error:
        raise InputError(f"{nominal.name}: is no XML ({error}); expected the URDF that was calibrated") from None
    if robot.tag != "robot":
        raise InputError(f"{nominal.name}: the root element is <{robot.tag}>, expected <robot> as in a URDF file")
    used: set[str] = set()
    for joint in robot.findall("joint"):
        name = joint.get("name", "")
        keys = [f"{name}_{axis}" for axis in "xyzabc"]
        turn = Rotation.from_rotvec([offsets.get(key, 0.0) for key in keys[3:]]).as_matrix()
        frame = se3.frame(turn, [offsets.get(key, 0.0) for key in keys[:3]])
        if found := {name, *keys} & offsets.keys():
            _set_origin(
                joint, origin_of(joint, nominal.name) @ frame @ _motion(joint, offsets.get(name, 0.0), nominal.name)
            )
            used |= found
    if not used:
        raise InputError(f"{path.name}: has offsets, but none of a joint of {nominal.name}: {choices('', offsets)}")
    left = left_out(f"no joint of {nominal.name}", sorted(offsets.keys() - used))
    note = "; ".join([f"{nominal.name} with the offsets of {path.name}", *(f"left out, {text}" for text in left)])
    robot.insert(0, ET.Comment(f" {note.replace('--', '- -')} "))
    return Imported(ET.tostring(robot, encoding="unicode") + "\n", left_out=left)


_LINE = re.compile(r"""("(?:[^"\\]|\\.)*"|'(?:[^']|'')*'|[^#"']*?)\s*:\s*([^\s#]+)\s*(?:#.*)?""")
"""Line of a YAML file: a name, plain or in quotes, and a value."""


def _offsets(path: Path) -> dict[str, float]:
    out: dict[str, float] = {}
    for number, line in enumerate(read_text(path, LARGEST_FILE, OFFSETS).splitlines(), 1):
        if not (text := line.strip()) or text[0] == "#" or text == "---":
            continue
        found = _LINE.fullmatch(text)
        try:
            name, value = (_unquoted(found[1]), float(found[2])) if found else ("", math.nan)
        except ValueError:
            name, value = "", math.nan
        if not abs(value) <= LARGEST["length"]:
            raise InputError(f"{path.name}, line {number}: {text[:60]!r}; expected {OFFSETS}")
        out[name] = value
    return out


def _unquoted(name: str) -> str:
    """Return a name of a YAML file without its quotes. Raises ValueError for an escape sequence that JSON lacks."""
    return str(json.loads(name)) if name.startswith('"') else name.strip("'").replace("''", "'")


def _given(joint: ET.Element, tag: str, key: str, default: str, file: str) -> list[float]:
    """Return the three numbers of an attribute of a URDF joint's tag, such as `xyz`."""
    place = joint.find(tag)
    text = default if place is None else place.get(key, default)
    try:
        out = [float(word) for word in text.split()]
    except ValueError:
        out = []
    if len(out) != 3:
        raise InputError(f"{file}, joint '{joint.get('name')}', {tag}: '{text}'; expected three numbers")
    return out


def origin_of(joint: ET.Element, file: str) -> Array:
    """Return the transform (4, 4), m, from the parent link of a URDF joint to the joint. Raises InputError naming the
    file."""
    turn = Rotation.from_euler("xyz", _given(joint, "origin", "rpy", "0 0 0", file)).as_matrix()
    return se3.frame(turn, _given(joint, "origin", "xyz", "0 0 0", file))


def axis_of(joint: ET.Element, file: str) -> list[float]:
    """Return the direction of the axis of a URDF joint. Raises InputError naming the file."""
    return _given(joint, "axis", "xyz", "1 0 0", file)


def _motion(joint: ET.Element, value: float, file: str) -> Array:
    along = np.array(axis_of(joint, file))
    along = along / (np.linalg.norm(along) or 1.0)
    slides = joint.get("type") == "prismatic"
    return np.asarray(se3.exp(value * np.concatenate([along * slides, along * (not slides)])))


def _set_origin(joint: ET.Element, frame: Array) -> None:
    place = joint.find("origin")
    place = ET.SubElement(joint, "origin") if place is None else place
    for key, own in (("xyz", frame[:3, 3]), ("rpy", se3.roll_pitch_yaw(frame[:3, :3]))):
        place.set(key, " ".join(repr(float(v)) for v in own))


LARGEST_CAMERA = 64 << 20
"""Largest size of a camera file, bytes: corners of ten thousand views."""
A_CAMERA = "a camera's YAML, or corners, as OpenCV or ROS writes them"


def camera_or_corners(path: Path, joints: Path | None, square: float | None) -> Imported:
    """Import the file of a camera; if it holds corners, import a table of pixels together with camera and board.

    joints: table of joint values with units, one row per view with corners.
    square: distance between neighbouring corners, m.
    Raises InputError if a file is missing, the lens model is not plumb_bob, or the numbers of views and rows differ.
    Sources: OpenCV, samples/cpp/calibration.cpp (image_points, board_width, board_height) and FileStorage, whose first
    line is not valid YAML; ROS, camera_calibration_parsers (camera_matrix, distortion_model plumb_bob).
    """
    content = _camera_file(path)
    if "image_points" not in content:
        return Imported({"camera": {_camera_name(content, path): _lens(content, path)}})
    if joints is None or square is None:
        raise InputError(f"{path.name}: holds corners; expected --joints POSES.csv and --square SIZE too")
    points = _matrix(content, "image_points", path)
    columns, rows = _side(content, "board_width", path), _side(content, "board_height", path)
    corners = columns * rows
    if points.size % (2 * corners):
        raise InputError(f"{path.name}: {points.size // 2} corners; expected {columns} x {rows} of every view")
    pixels, (poses, _) = points.reshape(-1, 2), read_frame(joints)
    if len(pixels) != len(poses) * corners:
        views = len(pixels) // corners
        raise InputError(f"{joints.name}: {len(poses)} rows, {views} views in {path.name}; expected a row a view")
    for header, column in poses.items():
        if str(header) not in LABELS:
            _, unit = split_header(str(header))
            if unit is None:
                raise InputError(f"{joints.name}, column '{header}': no unit; write for example '{header} [deg]'")
            numbers(column, f"{joints.name}, column '{header}'")
    name = _camera_name(content, path)
    table = poses.loc[poses.index.repeat(corners)].reset_index(drop=True)
    table = table.assign(camera=name, marker=[str(i) for i in range(corners)] * len(poses))
    table = table.assign(**{"u [px]": cells(pixels[:, 0]), "v [px]": cells(pixels[:, 1])})
    board = {"link": "tool", "columns": columns, "rows": rows, "pitch_mm": 1e3 * square}
    described = {"cameras": {"camera": {name: _lens(content, path)}}, "board": {"board": {"B": board}}}
    return Imported(pd.DataFrame(table), described)


def _camera_file(path: Path) -> dict[str, object]:
    try:
        import yaml  # not a test of a lean installation: pint's optional dask imports yaml too
    except ModuleNotFoundError as error:
        raise InputError(f"reading {path.name} needs yaml: pip install 'gpmodel[ros]'") from error

    loader = type("OpenCvLoader", (yaml.SafeLoader,), {})
    yaml.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda l, node: l.construct_mapping(node, True), loader)
    text = read_text(path, LARGEST_CAMERA, A_CAMERA)
    try:
        content = yaml.load(text.removeprefix(text.splitlines()[0]) if text.startswith("%YAML") else text, loader)
    except (yaml.YAMLError, RecursionError):
        raise InputError(f"{path}: is no YAML; expected {A_CAMERA}") from None
    if not isinstance(content, dict) or not {"camera_matrix", "image_points"} & {str(k).lower() for k in content}:
        raise InputError(f"{path}: no camera_matrix and no image_points; expected {A_CAMERA}")
    return {str(key).lower(): value for key, value in content.items()}


def _camera_name(content: dict[str, object], path: Path) -> str:
    given = str(content.get("camera_name", path.stem))
    return "".join(c if c.isalnum() or c in "_-" else "_" for c in given)


def _lens(content: dict[str, object], path: Path) -> dict[str, object]:
    """Return the description of a camera fixed in the world, without lens parameters if the file has none."""
    if "camera_matrix" not in content:
        return {"link": "world"}
    model = str(content.get("distortion_model", "plumb_bob"))
    bent = _matrix(content, "distortion_coefficients", path) if "distortion_coefficients" in content else np.zeros(5)
    k = _matrix(content, "camera_matrix", path)
    if k.size != 9 or k[1] != 0.0:
        raise InputError(f"{path.name}: camera_matrix is {k.tolist()}; expected fx 0 cx 0 fy cy 0 0 1")
    if model != "plumb_bob" or np.any(bent[5:]):
        said = model if model != "plumb_bob" else f"{bent.size} distortion coefficients"
        raise InputError(f"{path.name}: {said}; expected plumb_bob, k1, k2, p1, p2, k3")
    focal, centre = [float(k[0]), float(k[4])], [float(k[2]), float(k[5])]
    return {"link": "world", "focal_px": focal, "centre_px": centre, "distortion": bent[:5].tolist()}


def _side(content: dict[str, object], key: str, path: Path) -> int:
    given = content.get(key)
    if not isinstance(given, int) or given < 2:
        raise InputError(f"{path.name}: {key} is {given}; expected a whole number of corners, at least 2")
    return given


def _matrix(content: dict[str, object], key: str, path: Path) -> Array:
    """Return the numbers of a matrix of a camera file as a flat array."""
    given = content[key]
    try:
        found = np.asarray(given["data"] if isinstance(given, dict) else given, dtype=float).ravel()
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path.name}: {key} holds no table of numbers; expected {A_CAMERA}") from None
    if not len(found) or not np.isfinite(found).all():
        raise InputError(f"{path.name}: {key} is empty or not finite; expected numbers")
    return found


_MARKER = re.compile(r"^(?:phi)?[xyz](\d+)$")


def is_figaroh(path: Path) -> bool:
    """Return True if the header of a CSV file names the coordinates of a first marker, x1, y1 and z1."""
    return path.suffix.lower() == ".csv" and {"x1", "y1", "z1"} <= {str(c).strip() for c in read_frame(path)[0].columns}


def figaroh_map(path: Path, mechanism: Mechanism | None) -> ColumnMap:
    """Return the map of a FIGAROH file, for a table with one row per pose and marker.

    Several markers become tools of one set-up; the markers' rows of one pose form a group. Orientations of a marker are
    read only if the file has one marker. Raises InputError without a mechanism, or if a joint or coordinate is missing.
    Source: thanhndv212/figaroh-plus, calibration/data_loader.py.
    """
    if mechanism is None:
        raise InputError(f"{path.name}: joint values without units; expected --mechanism M, whose joints turn or slide")
    names = [str(column).strip() for column in read_frame(path)[0].columns]
    joints = {joint.name: f"{joint.name} [{JOINT_UNITS[joint.kind]}]" for joint in mechanism.joints}
    if missing := [name for name in joints if name not in names]:
        raise InputError(f"{path.name}: no values of joint '{missing[0]}'; the file has {choices(missing[0], names)}")
    markers = sorted({int(found[1]) for name in names if (found := _MARKER.match(name))})
    for k in markers:
        if missing := [f"{axis}{k}" for axis in "xyz" if f"{axis}{k}" not in names]:
            raise InputError(f"{path.name}: marker {k} has no column '{missing[0]}'; expected x{k}, y{k} and z{k}")
    points = {str(k): {axis: f"{axis}{k} [m]" for axis in "xyz"} for k in markers}
    if len(points) > 1:
        return ColumnMap(joints, source=f"the joints of {mechanism.name}", tools=points)
    angles = tuple(f"phi{axis}1 [rad]" for axis in "xyz")
    oriented = OrientationColumns(angles, "fixed XYZ") if "phix1" in names else None
    return ColumnMap(joints | points["1"], oriented, f"the joints of {mechanism.name}")


ROWS = ("theta", "d", "a", "alpha")
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""Names of the joints of Universal Robots in ROS, without the suffix `_joint`."""


def calibrated_rows(path: Path, nominal: Path | None) -> Imported:
    """Import the calibration of a Universal Robots arm as a mechanism: TOML of its corrected standard DH rows.

    T_i = Rz(q_i + delta_theta_i) Tz(d_i + delta_d_i) Tx(a_i + delta_a_i) Rx(alpha_i + delta_alpha_i)

    nominal: the file urcontrol.conf. The base frame is that of the UR controller.
    Raises InputError if a file or a line is missing, or a line does not have six numbers.
    Source: Universal Robots, forum threads 1638 and 18921; UniversalRobots/Universal_Robots_ROS_Driver, ur_calibration.
    """
    if nominal is None:
        raise InputError(
            f"{path.name}: corrections alone; expected --nominal urcontrol.conf, whose a, d, alpha they correct"
        )
    changes, rows = _lines(path), _lines(nominal) | {"theta": np.zeros(len(NAMES))}
    for known, file, names in ((rows, nominal, ROWS), (changes, path, [f"delta_{name}" for name in ROWS])):
        if missing := [name for name in names if name not in known]:
            raise InputError(f"{file.name}: no line '{missing[0]} = [...]'; expected {', '.join(names)}")
    lines = [f"# {nominal.name} corrected by {path.name}", f'name = "{path.stem}"', 'convention = "standard"', ""]
    for i, name in enumerate(NAMES):
        lines += ["[[joint]]", f'name = "{name}_joint"']
        for row, unit in zip(ROWS, ("rad", "m", "m", "rad"), strict=True):
            lines.append(f"{row}_{unit} = {float(rows[row][i] + changes[f'delta_{row}'][i])!r}")
        lines.append("")
    return Imported("\n".join(lines))


def _lines(path: Path) -> dict[str, Array]:
    """Read the lists of numbers of the Denavit-Hartenberg lines of a UR .conf file, by name of the line."""
    found = {}
    for name, text in re.findall(
        r"^\s*(\w+)\s*=\s*\[([^\]]*)\]", read_text(path, LARGEST_FILE, "a UR .conf file"), re.M
    ):
        if name.removeprefix("delta_") in ROWS:
            try:
                values = np.array([float(part) for part in text.split(",")])
            except ValueError:
                values = np.zeros(0)
            if len(values) != len(NAMES) or not (np.abs(values) <= LARGEST["length"]).all():
                message = f"{path.name}: {name} is [{text.strip()[:60]}]"
                raise InputError(f"{message}; expected {len(NAMES)} numbers of at most {LARGEST['length']:g} m or rad")
            found[name] = values
    return found
