"""Write twenty layouts of files that were known while the reader was written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.checks.notes import flange, registered
from gpmodel.mechanism.protocol import Mechanism


@dataclass(frozen=True)
class Session:
    """arm: what --mechanism is. q: (N, n) joint values, deg. p: (N, 3) measured, mm. turn: measured orientations. own,
    own_turn: flange of the controller's own forward kinematics, mm. second: (N, 3) another reflector, mm. warm: (N,)
    temperatures, degC. no: (N,) from 1."""

    arm: str
    mechanism: Mechanism
    q: Array
    p: Array
    turn: Rotation
    own: Array
    own_turn: Rotation
    second: Array
    warm: Array
    no: Array

    def rows(self, kept: Sequence[int]) -> Session:
        """Some of the rows."""
        parts = {name: value[list(kept)] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return replace(self, turn=self.turn[list(kept)], own_turn=self.own_turn[list(kept)], **parts)


@dataclass(frozen=True)
class Case:
    """files: what was written. truth: the session that is to come out, None where it is to be refused. told: how often
    each pose is in it."""

    files: tuple[Path, ...]
    arm: str
    truth: Session | None
    told: int = 1


def session(arm: str, rows: int, seed: int) -> Session:
    """Poses of an arm with geometric errors, measured by a tracker, digits as instruments write them."""
    rng = np.random.default_rng(seed)
    made = gp.simulate(arm, ["joint_compliance J2=1e-6"], poses=rows, noise="0.02mm", geometry_sigma="0.3mm", seed=seed)
    mechanism, data = gp.load_mechanism(arm), made.table
    frames = flange(mechanism, data.q)
    found = registered(frames, data.position)
    mount = Rotation.from_rotvec(rng.normal(size=3))
    shaken = Rotation.from_rotvec(2e-4 * rng.normal(size=(rows, 3)))
    turn = Rotation.from_matrix(found.turn @ frames[:, :3, :3]) * mount * shaken
    tool = found.tool + np.array([0.08, -0.05, 0.06])
    second = (frames[:, :3, 3] + frames[:, :3, :3] @ tool) @ found.turn.T + found.shift
    second += data.position - found.points(frames) + 2e-5 * rng.normal(size=(rows, 3))
    return Session(
        arm, mechanism, np.round(np.degrees(data.q), 4), np.round(1e3 * data.position, 4), turn,
        np.round(1e3 * frames[:, :3, 3], 3), Rotation.from_matrix(frames[:, :3, :3]), np.round(1e3 * second, 4),
        np.round(20.0 + np.linspace(0, 3, rows) + 0.1 * rng.normal(size=rows), 2), np.arange(1, rows + 1),
    )  # fmt: skip


def radians(s: Session, digits: int = 7) -> Array:
    """Joint values, rad."""
    return np.asarray(np.round(np.radians(s.q), digits))


def table(*blocks: object, by: str = ",", comma: bool = False) -> list[str]:
    """Lines of blocks side by side: numbers (N,) or (N, k), or N texts; one text or number stands in every line."""
    count = max(len(b) for b in blocks if np.ndim(b))  # type: ignore[arg-type]
    wide = [np.asarray(b if np.ndim(b) else [b] * count, dtype=object).reshape(count, -1) for b in blocks]
    lines = [by.join(str(cell) for cell in row) for row in np.hstack(wide)]
    return [line.replace(".", ",") for line in lines] if comma else lines


def names(form: str, count: int = 6, first: int = 1) -> list[str]:
    """Numbered names."""
    return [form.format(i) for i in range(first, first + count)]


def write(path: Path, lines: Sequence[str], encoding: str = "utf-8") -> Path:
    """A file of lines."""
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def leica(folder: Path) -> Case:
    """Leica, tracker and joints in one file"""
    s = session("ur10", 40, 1)
    head = [*names("J{} [deg]"), "X  [mm]", "Y  [mm]", "Z  [mm]", "U(95)  [mm]", "Target", "Temperature  [°C]",
            "Pressure  [mBar]", "Time Stamp", "Delete"]  # fmt: skip
    stamps = [f"'03.02.2024 10:{k:02}:00.5" for k in range(40)]
    rows = table(s.q, s.p, 0.02 + 0.001 * (s.no % 4), "BALL 30 #1", s.warm, 1013 + s.no % 3, stamps, "")
    return Case((write(folder / "at.csv", [",".join(head), *rows], "cp1252"),), s.arm, s)


def polyworks(folder: Path) -> Case:
    """PolyWorks, nominal and measured points; joints in a second file"""
    s = session("irb6400r", 45, 2)
    head = ["Name", *(f"{w} {a}" for w in ("Nominal", "Measured") for a in "XYZ"), "Deviation"]
    rows = table([f"point {k}" for k in s.no], np.round(s.own, 1), s.p, 0.1 + s.no % 3, by="\t")
    pose = write(folder / "poses.csv", ["J1;J2;J3;J4;J5;J6", *table(s.q, by=";")])
    points = write(folder / "pw.txt", ["Units: Millimeters", "", "\t".join(head), *rows])
    return Case((pose, points), s.arm, s)


def spatial_analyzer(folder: Path) -> Case:
    """SpatialAnalyzer, points in another order; joints in a second file"""
    s = session("ur10", 40, 3)
    pose = write(folder / "joints.csv", [",".join(["Point", *names("A{}")]), *table([f"p{k}" for k in s.no], s.q)])
    s = s.rows(np.random.default_rng(3).permutation(40).tolist())
    rows = table([f"A::robot::p{k}" for k in s.no], s.p, "", "")
    head = "// Collection::Group::Point, X, Y, Z, OffsetP, OffsetR"
    return Case((pose, write(folder / "sa.csv", [head, *rows])), s.arm, s)


def robodk(folder: Path) -> Case:
    """RoboDK, calibration measurements"""
    s = session("ur10", 35, 4)
    head = ",".join([*names("Joint {} (deg)"), "X (mm)", "Y (mm)", "Z (mm)"])
    return Case((write(folder / "robodk.csv", [head, *table(s.q, s.p)]),), s.arm, s)


def kuka_axes(folder: Path) -> Case:
    """KUKA, E6AXIS of a .dat file; points in a second file without header"""
    s = session("irb6400r", 40, 5)
    axes = table(*(block for k in range(6) for block in (f"A{k + 1}", s.q[:, k])), by=" ")
    points = [f"DECL E6AXIS XP{k}={{{row},E1 0.0,E2 0.0}}" for k, row in zip(s.no, axes, strict=True)]
    pose = write(folder / "cal.dat", ["&ACCESS RVP", "DEFDAT CAL PUBLIC", *points, "ENDDAT"])
    return Case((pose, write(folder / "p.txt", table(s.p, by=" "))), s.arm, s)


def kuka_own(folder: Path) -> Case:
    """KUKA, logged axes and positions of the controller"""
    s = session("ur10", 40, 6)
    abc = np.round(s.own_turn.as_euler("ZYX", degrees=True), 4)
    rows = table(s.q, s.own, abc, by=";", comma=True)
    return Case((write(folder / "log.csv", ["A1;A2;A3;A4;A5;A6;X;Y;Z;A;B;C", *rows]),), s.arm, None)


def abb(folder: Path) -> Case:
    """ABB, jointtargets of a module; points by name, one not measured"""
    s = session("irb6400r", 40, 7)
    targets = [
        f"  CONST jointtarget p{10 * k}:=[[{row}],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];"
        for k, row in zip(s.no, table(s.q), strict=True)
    ]
    module = write(folder / "cal.mod", ["MODULE cal", *targets, "ENDMODULE"])
    s = s.rows([k for k in range(40) if k != 7])
    rows = table([f"p{10 * k}" for k in s.no], s.p, by="\t")
    return Case((module, write(folder / "tracker.txt", ["Name\tX\tY\tZ", *rows])), s.arm, s)


def fanuc(folder: Path) -> Case:
    """Fanuc, joint positions of a .ls program; points with decimal commas"""
    s = session("ur10", 40, 8)
    out = ["/PROG CAL", "/POS"]
    for k, q in zip(s.no, s.q, strict=True):
        j = [f"J{i + 1}= {v:9.4f} deg" for i, v in enumerate(q)]
        out += [f"P[{k}]{{", "   GP1:", "\tUF : 0, UT : 1,", f"\t{', '.join(j[:3])},", f"\t{', '.join(j[3:])}", "};"]
    rows = table(s.no, s.p, by=";", comma=True)
    points = write(folder / "m.csv", ["No;X in mm;Y in mm;Z in mm", *rows])
    return Case((write(folder / "cal.ls", [*out, "/END"]), points), s.arm, s)


def ur_own(folder: Path) -> Case:
    """Universal Robots, RTDE record with positions of the controller"""
    s = session("ur10", 60, 9)
    head = ["timestamp", *names("actual_q_{}", 6, 0), *names("actual_TCP_pose_{}", 6, 0)]
    vectors = np.round(s.own_turn.as_rotvec(), 6)
    rows = table(10 + 0.5 * s.no, radians(s, 6), np.round(1e-3 * s.own, 6), vectors, by=" ")
    return Case((write(folder / "rtde.csv", [" ".join(head), *rows]),), s.arm, None)


def ur_tracker(folder: Path) -> Case:
    """Universal Robots, target and actual joints beside a tracker's points"""
    s = session("ur10", 60, 10)
    target = np.round(np.radians(s.q) + 1e-4 * np.random.default_rng(10).normal(size=s.q.shape), 5)
    head = [*names("target_q_{}", 6, 0), *names("actual_q_{}", 6, 0), "x", "y", "z"]
    rows = table(target, radians(s, 6), np.round(1e-3 * s.p, 7))
    return Case((write(folder / "ur.csv", [",".join(head), *rows]),), s.arm, s)


def optitrack(folder: Path) -> Case:
    """OptiTrack Motive, a header of four lines; joints in a second file"""
    s = session("ur10", 40, 11)
    joints = ",".join(f"{n}_joint" for n in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
    head = ["Format Version,1.23,Take Name,cal,Length Units,Meters", "", ",," + ",".join(["Rigid Body"] * 7),
            ",," + ",".join(["tool"] * 7), ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
            "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z"]  # fmt: skip
    rows = table(s.no, 0.5 * s.no, np.round(s.turn.as_quat(), 6), np.round(1e-3 * s.p, 6))
    pose = write(folder / "q.csv", [joints, *table(radians(s))])
    return Case((pose, write(folder / "motive.csv", [*head, *rows])), s.arm, s)


def ndi(folder: Path) -> Case:
    """NDI, quaternion before position, seven joints"""
    s = session("panda", 50, 12)
    quaternions = np.round(s.turn.as_quat(scalar_first=True), 5)
    head = [*names("q{}", 7), "Frame", "State", "Q0", "Qx", "Qy", "Qz", "Tx", "Ty", "Tz", "Error"]
    rows = table(radians(s), 100 + s.no, "OK", quaternions, s.p, 0.1 + 0.01 * (s.no % 5))
    return Case((write(folder / "ndi.csv", [",".join(head), *rows]),), s.arm, s)


def german(folder: Path) -> Case:
    """German sheet, decimal commas, two lines above"""
    s = session("irb6400r", 40, 13)
    head = ["Nr.", *names("Achse {} [Grad]"), *(f"{a}-Ist [mm]" for a in "XYZ"), "Temperatur [°C]"]
    rows = table(s.no, s.q, s.p, s.warm, by=";", comma=True)
    above = ["Messung vom 3.2.2024", "Prüfer: Müller", ";".join(head)]
    return Case((write(folder / "mess.csv", [*above, *rows], "latin-1"),), s.arm, s)


def unicode_text(folder: Path) -> Case:
    """Excel's Unicode text, UTF-16"""
    s = session("ur10", 40, 14)
    head = "\t".join([*names("AXIS {}"), *"XYZ"])
    return Case((write(folder / "sheet.txt", [head, *table(s.q, s.p, by="\t")], "utf-16"),), s.arm, s)


def excel(folder: Path) -> Case:
    """Excel, a line above the names and one of units below them"""
    s = session("irb6400r", 40, 15)
    head = [["Session", "A", *[""] * 8], ["No", *names("Axis {}"), *"XYZ"], ["", *["deg"] * 6, *["mm"] * 3]]
    body = np.column_stack([s.no, s.q, s.p]).tolist()
    pd.DataFrame([*head, *body]).to_excel(folder / "book.xlsx", index=False, header=False)
    return Case((folder / "book.xlsx",), s.arm, s)


def reflectors(folder: Path) -> Case:
    """FIGAROH, two markers a row"""
    s = session("irb6400r", 40, 16)
    head = ",".join([*(f"{a}{m}" for m in (1, 2) for a in "xyz"), *names("J{}")])
    rows = table(np.round(1e-3 * s.p, 7), np.round(1e-3 * s.second, 7), radians(s))
    return Case((write(folder / "markers.csv", [head, *rows]),), s.arm, s, 2)


def ros_topic(folder: Path) -> Case:
    """ROS, rostopic echo -p of joint states and of points"""
    s = session("ur10", 40, 17)
    stamps = [1700000000000000000 + 500000000 * int(k) for k in s.no]
    head = "%time,field.header.seq,field.header.stamp," + ",".join(names("field.position{}", 6, 0))
    pose = write(folder / "joint_states.csv", [head, *table(stamps, s.no, stamps, radians(s))])
    rows = table([stamp + 10000000 for stamp in stamps], np.round(1e-3 * s.p, 7))
    points = write(folder / "tracker.csv", ["%time,field.point.x,field.point.y,field.point.z", *rows])
    return Case((pose, points), s.arm, s)


def franka(folder: Path) -> Case:
    """Franka, joints, the controller's matrix and a tracker's points"""
    s = session("panda", 60, 18)
    frames = np.zeros((60, 4, 4))
    frames[:, :3, :3], frames[:, :3, 3], frames[:, 3, 3] = s.own_turn.as_matrix(), 1e-3 * s.own, 1
    head = [*names("q[{}]", 7, 0), *names("O_T_EE[{}]", 16, 0), "x_tracker", "y_tracker", "z_tracker"]
    rows = table(radians(s), np.round(frames.transpose(0, 2, 1).reshape(60, 16), 6), s.p)
    return Case((write(folder / "franka.csv", [",".join(head), *rows]),), s.arm, s)


def bare(folder: Path) -> Case:
    """MATLAB's save -ascii, no header"""
    s = session("irb6400r", 30, 19)
    rows = [" ".join(f"{v:.8e}" for v in row) for row in np.column_stack([s.p, s.q])]
    return Case((write(folder / "matlab.txt", rows),), s.arm, s)


def coupled(folder: Path) -> Case:
    """Fanuc pendant, J3 counted from J2"""
    s = session("ur10", 40, 20)
    shown = s.q.copy()
    shown[:, 2] = np.round(s.q[:, 2] + s.q[:, 1], 4)
    return Case((write(folder / "pendant.csv", ["J1,J2,J3,J4,J5,J6,X,Y,Z", *table(shown, s.p)]),), s.arm, s)


WRITTEN = (
    leica, polyworks, spatial_analyzer, robodk, kuka_axes, kuka_own, abb, fanuc, ur_own, ur_tracker, optitrack, ndi,
    german, unicode_text, excel, reflectors, ros_topic, franka, bare, coupled,
)  # fmt: skip
