"""Cameras written by OpenCV and ROS, and corners found by OpenCV.

Sources: OpenCV, samples/cpp/calibration.cpp (image_points, board_width, board_height) and FileStorage, whose first line
is no YAML of its own version; ROS, camera_calibration_parsers (camera_matrix, distortion_model plumb_bob).
"""

from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.table.cells import numbers, read_frame
from gpmodel.table.dataset import LABELS
from gpmodel.table.imported import Imported, cells
from gpmodel.table.units import split_header
from gpmodel.texts import read_text

LARGEST = 64 << 20
"""Bytes: corners of ten thousand views."""
EXPECTED = "a camera's YAML, or corners, as OpenCV or ROS writes them"


def camera_or_corners(path: Path, joints: Path | None, square: float | None) -> Imported:
    """Cameras as a TOML file has them; or, of a file with corners, the table of pixels with camera and board beside it.

    joints: a table of joint values with units, a row a view in which corners were found. square: from corner to corner,
    m. Raises InputError: no such file, another lens than plumb_bob, as many views as rows there are not.
    """
    content = _read(path)
    if "image_points" not in content:
        return Imported({"camera": {_name(content, path): _lens(content, path)}})
    if joints is None or square is None:
        raise InputError(f"{path.name}: holds corners; expected --joints POSES.csv and --square SIZE beside them")
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
    name = _name(content, path)
    table = poses.loc[poses.index.repeat(corners)].reset_index(drop=True)
    table = table.assign(camera=name, marker=[str(i) for i in range(corners)] * len(poses))
    table = table.assign(**{"u [px]": cells(pixels[:, 0]), "v [px]": cells(pixels[:, 1])})
    board = {"link": "tool", "columns": columns, "rows": rows, "pitch_mm": 1e3 * square}
    described = {"cameras": {"camera": {name: _lens(content, path)}}, "board": {"board": {"B": board}}}
    return Imported(pd.DataFrame(table), described)


def _read(path: Path) -> dict[str, object]:
    try:
        import yaml  # pint's optional dask imports it too: no module that a lean installation can be told by
    except ModuleNotFoundError as error:
        raise InputError(f"reading {path.name} needs yaml: pip install 'gpmodel[ros]'") from error

    loader = type("OpenCvLoader", (yaml.SafeLoader,), {})
    yaml.add_constructor("tag:yaml.org,2002:opencv-matrix", lambda l, node: l.construct_mapping(node, True), loader)
    text = read_text(path, LARGEST, EXPECTED)
    try:
        content = yaml.load(text.removeprefix(text.splitlines()[0]) if text.startswith("%YAML") else text, loader)
    except (yaml.YAMLError, RecursionError):
        raise InputError(f"{path}: is no YAML; expected {EXPECTED}") from None
    if not isinstance(content, dict) or not {"camera_matrix", "image_points"} & {str(k).lower() for k in content}:
        raise InputError(f"{path}: no camera_matrix and no image_points; expected {EXPECTED}")
    return {str(key).lower(): value for key, value in content.items()}


def _name(content: dict[str, object], path: Path) -> str:
    given = str(content.get("camera_name", path.stem))
    return "".join(c if c.isalnum() or c in "_-" else "_" for c in given)


def _lens(content: dict[str, object], path: Path) -> dict[str, object]:
    """A camera that stands in the world; of no known lens where the file has none."""
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
        raise InputError(f"{path.name}: {key} is {given}; expected corners along that side of the board")
    return given


def _matrix(content: dict[str, object], key: str, path: Path) -> Array:
    """Its numbers in a row."""
    given = content[key]
    try:
        found = np.asarray(given["data"] if isinstance(given, dict) else given, dtype=float).ravel()
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path.name}: {key} holds no table of numbers; expected {EXPECTED}") from None
    if not len(found) or not np.isfinite(found).all():
        raise InputError(f"{path.name}: {key} is empty or not finite; expected numbers")
    return found
