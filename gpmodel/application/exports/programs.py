"""Write compensated targets as data of a robot program: a RAPID module or a KRL data list.

Joint targets set the joint values only. Cartesian targets contain the frame of the controller's nominal kinematics at
the corrected joint values: the measured link in the root, without tool and work object.
Sources: ABB, Technical reference manual RAPID, data types jointtarget, robtarget, confdata; KUKA, Operating and
programming instructions KSS, E6AXIS and FRAME, whose A, B, C turn about z, y', x''. RAPID's quaternion is q1 (real)
to q4. `program_read` reads a program back by the grammar of its language, without code of the writer.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from textwrap import wrap
from typing import Literal

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.characters import harmless
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics import se3
from gpmodel.table.convention import Convention
from gpmodel.table.robot_programs import AXES, CORRECTED_BY, NO_AXIS, RobotProgram, fields_of, rewritten
from gpmodel.table.units import factor, split_header

Language = Literal["RAPID", "KRL"]
LANGUAGES: tuple[Language, ...] = ("RAPID", "KRL")

NAME = 24
"""Number of characters of the longest name in KRL. RAPID allows names of 32 characters."""


WIDTH = 110
"""Number of characters of a comment line."""


def convention_notes(convention: Convention | None) -> list[str]:
    """Return the head lines of a program on the convention of its joint values."""
    if convention is None:
        return wrap(
            "CAUTION: the convention of the controller is not known. Joint values have the signs, zeros and couplings "
            "of the description; compare them with the controller before it runs this program.", WIDTH
        )  # fmt: skip
    said = "; ".join(f"{harmless(line.strip())}" for line in convention.text.split(";"))
    return wrap(
        "Joint values are in the convention of the imported joint columns. Joints of the description in terms of these "
        f"columns, deg and mm: {said}", WIDTH
    )  # fmt: skip


def rewritten_text(
    program: RobotProgram, mechanism: Mechanism, corrected: pd.DataFrame, convention: Convention | None
) -> str:
    """Write corrected joint values in the places of the joint targets of a program.

    Raises InputError if a target has no corrected joint values, or if the rows are not the targets of the program.
    """
    q = _joints(mechanism, corrected)
    if [str(line) for line in corrected.get("line [1]", [])] != [str(line) for line in program.lines]:
        raise InputError(
            f"{len(q)} rows for {len(program.lines)} targets of {program.name}; expected the table of compensate"
        )
    lost = np.flatnonzero(~np.isfinite(q).all(axis=1))
    if len(lost):
        status = corrected["status"].iloc[lost[0]]
        raise InputError(
            f"{program.name}, line {program.lines[lost[0]]}: {status} ({len(lost)} of {len(q)} targets); expected "
            "targets that can be corrected, or --out TABLE.csv to see all"
        )
    made = f"{len(q)} joint targets {CORRECTED_BY}{mechanism.name}."
    unchanged = [f"{program.cartesian} Cartesian positions are NOT corrected."] * bool(program.cartesian)
    lines = dict[str, list[int]]()
    for line, status in zip(program.lines, corrected["status"], strict=True):
        lines.setdefault(str(status), []).append(line)
    said = [f"{status}: lines {', '.join(map(str, at))}" for status, at in lines.items() if status != "ok"]
    notes = [made, *unchanged, *(part for text in said for part in wrap(text, WIDTH)), *convention_notes(convention)]
    return rewritten(program, mechanism, q, convention, notes)


def program_text(
    mechanism: Mechanism, corrected: pd.DataFrame, language: Language, name: str, convention: Convention | None = None
) -> str:
    """Write compensated targets as a robot program; j1 and p1 are row 1. Targets without values become comments.

    convention: convention of the controller, in which the joint values are written; None to write those of the
    description. Columns E1, E2, ... [deg] or [mm] that are no joints are written as external axes.
    Raises InputError if the joints are not those of the mechanism, for more than six robot axes, or if no row has
    corrected values.
    """
    q, status = _joints(mechanism, corrected), [str(s) for s in corrected.get("status", [""] * len(corrected))]
    there: Mask = np.asarray(np.isfinite(q).all(axis=1))
    if not there.any():
        raise InputError(f"none of the {len(q)} targets has corrected joint values; expected at least one")
    name = re.sub(r"\W", "_", name, flags=re.ASCII)[:NAME]
    name = name if name[:1].isalpha() else f"p_{name}"[:NAME]
    made = f"{CORRECTED_BY.capitalize()}{mechanism.name}."
    notes = [harmless(line) for line in (made, *convention_notes(convention), *_said(there, status))]
    write = _rapid if language == "RAPID" else _krl
    frames = se3.chain(mechanism.transforms(q[there]))[-1]
    fields = fields_of(mechanism, convention)
    values = q[there] if convention is None else convention.of_controller(q[there])
    scales = np.array([1e3 if j.kind == "prismatic" else np.degrees(1.0) for j in mechanism.joints])
    axes = dict(zip(fields, (values * scales).T, strict=True)) | _other_axes(corrected[there], fields)
    axes |= {f"A{k}": np.zeros(len(values)) for k in range(1, AXES + 1) if f"A{k}" not in axes}

    def text(notes: list[str]) -> str:
        lines = write(name, notes, np.flatnonzero(there) + 1, dict(sorted(axes.items())), frames)
        return "\n".join(line.encode("ascii", "replace").decode() for line in lines) + "\n"

    places = [sorted(axes).index(field) for field in fields]

    def nominal(values: Array) -> Array:
        q = values[:, places] / scales
        return q if convention is None else convention.of_description(q)

    return text([*notes, _read_back(mechanism, text(notes), scales, q[there], nominal)])


def _read_back(mechanism: Mechanism, text: str, scales: Array, q: Array, nominal: Callable[[Array], Array]) -> str:
    """State the differences between a robot program, read back, and the joint values, rad or m, and frames.

    nominal: joint values of the description, rad or m, from all axes of the program.
    """
    joints, frames = program_read(text)
    values = nominal(np.array(list(joints.values())))
    wanted, found = se3.chain(mechanism.transforms(values))[-1], np.array([frames[row] for row in joints])
    off = 1e3 * np.linalg.norm(found[:, :3, 3] - wanted[:, :3, 3], axis=1).max()
    turned = Rotation.from_matrix(found[:, :3, :3]) * Rotation.from_matrix(wanted[:, :3, :3]).inv()
    return (
        f"Read back: joint values to {np.abs((values - q) * scales).max():.1g} deg or mm, frames to {off:.1g} mm and "
        f"{np.degrees(turned.magnitude().max()):.1g} deg of those."
    )


def _joints(mechanism: Mechanism, corrected: pd.DataFrame) -> Array:
    """Return the joint values, rad and m, of the columns corrected_JOINT, in the order of the joints."""
    columns = [str(c) for c in corrected.columns if str(c).startswith("corrected_")]
    if len(columns) != len(mechanism.joints):
        raise InputError(
            f"{len(columns)} columns corrected_JOINT and {len(mechanism.joints)} joints; "
            "expected the table of compensate"
        )
    out = []
    for column, joint in zip(columns, mechanism.joints, strict=True):
        unit, kind = split_header(column)[1] or "", "angle" if joint.kind == "revolute" else "length"
        out.append(pd.to_numeric(corrected[column]).to_numpy(dtype=float) * factor(unit, kind, column))
    return np.column_stack(out)


def _other_axes(corrected: pd.DataFrame, fields: tuple[str, ...]) -> dict[str, Array]:
    """Return the columns E1 to E6, [deg] or [mm], of external axes that are no joints of the mechanism."""
    named = {str(c): split_header(str(c)) for c in corrected.columns}
    other = {c: name for c, (name, unit) in named.items() if unit in ("deg", "mm") and name not in fields}
    return {
        name: pd.to_numeric(corrected[column]).to_numpy(dtype=float)
        for column, name in other.items()
        if re.fullmatch(r"E[1-6]", name)
    }


def _said(there: Mask, status: list[str]) -> Iterator[str]:
    for row, (given, word) in enumerate(zip(there.tolist(), status, strict=True), start=1):
        if not given or word != "ok":
            yield f"Row {row}: {'no target, ' if not given else ''}{word}."


def _rapid(name: str, notes: list[str], rows: IntArray, axes: Mapping[str, Array], frames: Array) -> Iterator[str]:
    yield f"MODULE {name}"
    yield from (f"  ! {note}" for note in notes)
    yield "  ! p: frames of tool0 in wobj0 by the nominal kinematics of the description, whose root and flange have"
    yield "  ! to be those of the controller. The fourth number of their configurations is not known: before MoveL or"
    yield "  ! MoveJ to them, ConfL \\Off and ConfJ \\Off. MoveAbsJ to j needs none."
    turns = Rotation.from_matrix(frames[:, :3, :3]).as_quat(canonical=True, scalar_first=True)
    for k, (row, point, turn) in enumerate(zip(rows, 1e3 * frames[:, :3, 3], turns, strict=True)):
        joints = np.array([axes[f"A{i}"][k] for i in range(1, AXES + 1)])
        outside = [_numbers(axes[f"E{i}"][[k]]) if f"E{i}" in axes else "9E9" for i in range(1, AXES + 1)]
        none = f"[{','.join(outside)}]"
        quarters = [int(np.floor(joints[axis] / 90.0)) for axis in (0, 3, 5)]
        yield f"  CONST jointtarget j{row}:=[[{_numbers(joints)}],{none}];"
        turned = f"[{_numbers(turn)}],[{','.join(map(str, quarters))},0]"
        yield f"  CONST robtarget p{row}:=[[{_numbers(point)}],{turned},{none}];"
    yield "ENDMODULE"


def _krl(name: str, notes: list[str], rows: IntArray, axes: Mapping[str, Array], frames: Array) -> Iterator[str]:
    yield f"DEFDAT {name} PUBLIC"
    yield from (f"  ; {note}" for note in notes)
    yield "  ; p: frames of the flange, $TOOL=$NULLFRAME, in $BASE=$NULLFRAME by the nominal kinematics of the"
    yield "  ; description, whose root and flange have to be those of the controller"
    turns = np.degrees([se3.roll_pitch_yaw(frame[:3, :3]) for frame in frames])[:, ::-1]
    joints = np.column_stack(list(axes.values()))
    for row, values, point, turn in zip(rows, joints, 1e3 * frames[:, :3, 3], turns, strict=True):
        yield f"  DECL GLOBAL E6AXIS j{row}={{{_fields(list(axes), values)}}}"
        yield f"  DECL GLOBAL FRAME p{row}={{{_fields('XYZABC', [*point, *turn])}}}"
    yield "ENDDAT"


def _numbers(values: Array) -> str:
    return ",".join(f"{v:.9f}" for v in values)


def _fields(names: list[str] | str, values: Array | list[float]) -> str:
    return ",".join(f"{name} {v:.9f}" for name, v in zip(names, values, strict=True))


_RAPID = re.compile(r"^ *CONST (?P<kind>joint|rob)target [jp](?P<row>\d+):=(?P<value>.*);$", re.M)
_KRL = re.compile(r"^ *DECL GLOBAL (?P<kind>E6AXIS|FRAME) [jp](?P<row>\d+)=\{(?P<value>.*)\}$", re.M)
_NUMBER = re.compile(r"-?\d+\.?\d*(?:E\d+)?")


def program_read(text: str) -> tuple[dict[int, Array], dict[int, Array]]:
    """Return joint values, degrees or mm, and frames, m, of a robot program, by the row number of the target.

    Joint values are A1 to A6, followed by the external axes that have a value.
    """
    joints, frames = dict[int, Array](), dict[int, Array]()
    for said in _RAPID.finditer(text):
        numbers = np.array(_NUMBER.findall(said["value"]), dtype=float)
        if said["kind"] == "joint":
            joints[int(said["row"])] = numbers[numbers < NO_AXIS]
        else:
            frames[int(said["row"])] = se3.frame(
                Rotation.from_quat(numbers[3:7], scalar_first=True).as_matrix(), numbers[:3] / 1e3
            )
    for said in _KRL.finditer(text):
        field = {name: float(value) for name, value in (part.split() for part in said["value"].split(","))}
        if said["kind"] == "E6AXIS":
            joints[int(said["row"])] = np.array([field[axis] for axis in sorted(field)])
        else:
            turn = Rotation.from_euler("ZYX", [field[name] for name in "ABC"], degrees=True)
            frames[int(said["row"])] = se3.frame(turn.as_matrix(), np.array([field[name] for name in "XYZ"]) / 1e3)
    return joints, frames
