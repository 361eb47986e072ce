"""Universal Robots' calibration.conf: corrections to the Denavit-Hartenberg rows of urcontrol.conf.

    T_i = Rz(q_i + delta_theta_i) Tz(d_i + delta_d_i) Tx(a_i + delta_a_i) Rx(alpha_i + delta_alpha_i)

Source: Universal Robots, forum threads 1638 and 18921; UniversalRobots/Universal_Robots_ROS_Driver, ur_calibration.
"""

import re
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.quantities import LARGEST
from gpmodel.table.imported import Imported
from gpmodel.texts import read_text

LARGEST_FILE = 1 << 20
"""Bytes; the file has a thousand."""
ROWS = ("theta", "d", "a", "alpha")
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""Joints, as ROS calls them, with `_joint`."""


def calibrated_rows(path: Path, nominal: Path | None) -> Imported:
    """A mechanism: TOML of the corrected standard rows, in the axes of the controller's base. nominal: urcontrol.conf.

    Raises InputError where a file or one of its lines is missing, or a line has not six numbers.
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
    """Lists of numbers by the name before them; others are left out."""
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
                said = f"{path.name}: {name} is [{text.strip()[:60]}]"
                raise InputError(f"{said}; expected {len(NAMES)} numbers of at most {LARGEST['length']:g} m or rad")
            found[name] = values
    return found
