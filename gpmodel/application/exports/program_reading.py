"""Read robot programs back by the grammar of their language, without code of the writer.

Sources as in `programs`: RAPID's quaternion is q1 (real) to q4; KRL turns about z by A, then y' by B, then x'' by C.
"""

import re

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array

_RAPID = re.compile(r"^ *CONST (?P<kind>joint|rob)target [jp](?P<row>\d+):=(?P<value>.*);$", re.M)
_KRL = re.compile(r"^ *DECL GLOBAL (?P<kind>E6AXIS|FRAME) [jp](?P<row>\d+)=\{(?P<value>.*)\}$", re.M)
_NUMBER = re.compile(r"-?\d+\.?\d*(?:E\d+)?")


def program_read(text: str) -> tuple[dict[int, Array], dict[int, Array]]:
    """Return joint values (6,), degrees or mm, and frames (4, 4), m, by the row of their target."""
    joints, frames = dict[int, Array](), dict[int, Array]()
    for said in _RAPID.finditer(text):
        numbers = np.array(_NUMBER.findall(said["value"]), dtype=float)
        if said["kind"] == "joint":
            joints[int(said["row"])] = numbers[:6]
        else:
            frames[int(said["row"])] = _frame(Rotation.from_quat(numbers[3:7], scalar_first=True), numbers[:3])
    for said in _KRL.finditer(text):
        field = {name: float(value) for name, value in (part.split() for part in said["value"].split(","))}
        if said["kind"] == "E6AXIS":
            joints[int(said["row"])] = np.array([field[f"A{axis}"] for axis in range(1, 7)])
        else:
            turn = Rotation.from_euler("ZYX", [field[name] for name in "ABC"], degrees=True)
            frames[int(said["row"])] = _frame(turn, np.array([field[name] for name in "XYZ"]))
    return joints, frames


def _frame(turn: Rotation, point: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn.as_matrix(), point / 1e3
    return frame
