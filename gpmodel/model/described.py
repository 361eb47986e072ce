"""Read cameras, boards and surfaces from TOML files."""

from collections.abc import Callable, Mapping

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import checked
from gpmodel.model.pixel import Board, Camera
from gpmodel.model.surfaces import aligned
from gpmodel.model.touches import Feature
from gpmodel.numerics import se3
from gpmodel.table.units import TomlTable

KINDS = ("cameras", "board", "surfaces")
"""Kinds of objects that a TOML file of measuring equipment may describe."""

SOLVED = {"focal": (0, 1), "centre": (2, 3), "distortion": (4, 5, 6, 7), "distortion k3": (8,)}
"""Indices of the lens parameters that are estimated, by word of the entry `solve` in a camera's description."""

MOST_BENT = 1e4
"""Largest distortion coefficient of a lens; the coefficient k3 of a narrow lens may be some hundreds."""
MOST_MARKERS = 1000
"""Largest number of markers along a side of a board."""

Slot = Callable[[str, str], int]
"""Function of a link's name and its location in a file; returns the number of the frame that carries the link."""


def read_cameras(content: object, slot: Slot) -> tuple[Camera, ...]:
    """Read cameras [camera.NAME]: link, focal_px = [fx, fy], centre_px = [cx, cy], distortion = [k1, k2, p1, p2, k3]"""
    out = []
    for name, table in _named(content, "cameras", "camera"):
        focal, centre = table.numbers("focal_px", 2), table.numbers("centre_px", 2)
        for pixels in (*(() if focal is None else focal), *(() if centre is None else centre)):
            checked(float(pixels), "pixels", table.where)
        if focal is not None and not (focal > 0.0).all():
            raise InputError(f"{table.where}: focal_px is {focal.tolist()}, expected more than zero")
        known = np.zeros(9)
        known[:2], known[2:4] = (np.zeros(2) if part is None else part for part in (focal, centre))
        bent = table.take("distortion", [])
        numbers = isinstance(bent, list) and all(isinstance(v, int | float) and abs(v) <= MOST_BENT for v in bent)
        if not numbers or len(bent) > 5:
            message = f"expected at most 5 numbers up to {MOST_BENT:g}, [k1, k2, p1, p2, k3]"
            raise InputError(f"{table.where}: distortion is {bent!r}, {message}")
        known[4 : 4 + len(bent)] = bent
        asked = table.take("solve", ["focal", "centre", "distortion"] if focal is None else [])
        if not isinstance(asked, list) or not set(asked) <= set(SOLVED):
            raise InputError(f"{table.where}: solve is {asked!r}, expected some of {', '.join(SOLVED)}")
        solved = sorted({k for word in asked for k in SOLVED[word]} | {k for k in range(4) if known[k] == 0.0})
        out.append(Camera(name, slot(table.text("link", "world"), table.where), known, tuple(solved)))
        table.done()
    return tuple(out)


def read_boards(content: object, slot: Slot) -> tuple[tuple[Board, Mapping[str, Array]], ...]:
    """Read calibration boards [board.NAME]; return each board with {marker: corner (3,), m}.

    A board has a link, and either columns, rows and pitch_mm (markers 0, 1, ... row by row), or [board.NAME.points_mm]
    with a position [x, y, z] of each marker.
    """
    out = []
    for name, table in _named(content, "board", "board"):
        points = table.take("points_mm", None)
        if points is None:
            columns, rows = (int(table.number(side)) for side in ("columns", "rows"))
            pitch = table.quantity("pitch", "length", 0.0)
            if not (pitch > 0.0 and 2 <= columns <= MOST_MARKERS and 2 <= rows <= MOST_MARKERS):
                message = f"pitch_mm above zero, columns and rows from 2 to {MOST_MARKERS}"
                raise InputError(f"{table.where}: expected {message}")
            markers = {str(i): pitch * np.array([i % columns, i // columns, 0.0]) for i in range(columns * rows)}
        else:
            part = TomlTable(points, f"{table.where}: [points_mm]")
            markers = {marker: 1e-3 * part.needed(marker, 3) for marker in list(part.content)}
        corners = np.array([*markers.values()])
        if len(corners) < 4:
            raise InputError(f"{table.where}: {len(corners)} corners, expected at least 4")
        out.append((Board(name, slot(table.text("link", "tool"), table.where), corners), markers))
        table.done()
    return tuple(out)


def read_surfaces(content: object) -> tuple[tuple[Feature, ...], tuple[Feature, ...]]:
    """Read touched surfaces from [plane.NAME], [sphere.NAME] and [line.NAME].

    Returns the surfaces of one artefact, whose relative poses are known, and separate spheres of known diameter.
    probe_diameter_mm: diameter of the touching ball.
    """
    whole = TomlTable(content, "surfaces")
    probe = 0.5 * _not_negative(whole, "probe_diameter", 0.0)
    fixed: list[Feature] = []
    free: list[Feature] = []
    for name, table in _tables(whole, "plane"):
        normal, offset = _direction(table, "normal"), table.quantity("offset", "length", 0.0)
        fixed.append(Feature("on_plane", name, aligned(offset * normal, normal), probe))
    for name, table in _tables(whole, "line"):
        along, through = _direction(table, "direction"), table.quantity("point", "length", np.zeros(3), 3)
        fixed.append(Feature("on_line", name, aligned(through, along)))
    for name, table in _tables(whole, "sphere"):
        radius = 0.5 * _not_negative(table, "diameter", np.nan) + probe
        centre = table.quantity("centre", "length", None, 3)
        frame = se3.shift(np.zeros(3) if centre is None else centre)
        if centre is not None and np.isnan(radius):
            raise InputError(f"{table.where}: expected diameter_mm with centre_mm")
        (free if centre is None else fixed).append(Feature("on_sphere", name, frame, radius))
    whole.done()
    return tuple(fixed), tuple(free)


def _direction(table: TomlTable, key: str) -> Array:
    """Read a direction vector (3,) and scale it to length one."""
    vector = table.needed(key, 3)
    length = np.linalg.norm(vector)
    if not 0.0 < length < np.inf:
        raise InputError(f"{table.where}: {key} is {vector.tolist()}, expected a vector longer than zero")
    return np.asarray(vector / length)


def _not_negative(table: TomlTable, key: str, default: float) -> float:
    """Read a length, m, from a TOML table. Raises InputError if the length is negative."""
    value = float(table.quantity(key, "length", default))
    if value < 0.0:
        raise InputError(f"{table.where}: {key} is {1e3 * value:g} mm, expected zero or more")
    return value


def _named(content: object, what: str, word: str) -> list[tuple[str, TomlTable]]:
    whole = TomlTable(content, what)
    tables = list(_tables(whole, word))
    whole.done()
    if not tables:
        raise InputError(f"{what}: expected [{word}.NAME] and its keys below")
    return tables


def _tables(whole: TomlTable, word: str) -> list[tuple[str, TomlTable]]:
    part = whole.table(word)
    return [(name, TomlTable(table, f"{whole.where}: [{word}.{name}]")) for name, table in part.content.items()]
