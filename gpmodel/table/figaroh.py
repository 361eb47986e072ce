"""Calibration tables of FIGAROH: markers x1, y1, z1, x2, ... in m, perhaps phix1, phiy1, phiz1 in rad, and a column a
joint, rad and m, without units. Source: thanhndv212/figaroh-plus, calibration/data_loader.py."""

import re
from pathlib import Path

from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.cells import read_frame
from gpmodel.table.foreign import ColumnMap, OrientationColumns
from gpmodel.table.units import JOINT_UNITS

_MARKER = re.compile(r"^(?:phi)?[xyz](\d+)$")


def is_figaroh(path: Path) -> bool:
    """Return whether the header of a CSV file names a first marker."""
    return path.suffix.lower() == ".csv" and {"x1", "y1", "z1"} <= {str(c).strip() for c in read_frame(path)[0].columns}


def figaroh_map(path: Path, mechanism: Mechanism | None) -> ColumnMap:
    """A row a pose and marker: several markers are tools of one setup, rows of one pose one group. Angles are read of
    a single marker.

    Raises InputError without a mechanism, or where a joint or a coordinate of a marker is missing.
    """
    if mechanism is None:
        raise InputError(f"{path.name}: joint values without units; expected --mechanism M, whose joints turn or slide")
    names = [str(column).strip() for column in read_frame(path)[0].columns]
    joints = {joint.name: f"{joint.name} [{JOINT_UNITS[joint.kind]}]" for joint in mechanism.joints}
    if missing := [name for name in joints if name not in names]:
        raise InputError(f"{path.name}: no values of joint '{missing[0]}'; it has {choices(missing[0], names)}")
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
