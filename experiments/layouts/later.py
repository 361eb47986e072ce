"""Write twenty layouts of files that were added after the reader was written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from experiments.layouts.written import Case, names, radians, session, table, write

AXES = ",".join(names("J{}"))


def faro(folder: Path) -> Case:
    """FARO CAM2, separators at the ends of lines; joints with decimal commas"""
    s = session("irb6400r", 40, 31)
    points = write(folder / "cam2.csv", ["Name;X;Y;Z;", *table([f"M{k:03}" for k in s.no], s.p, "", by=";")])
    return Case((write(folder / "q.csv", [AXES.replace(",", ";"), *table(s.q, by=";", comma=True)]), points), s.arm, s)


def api(folder: Path) -> Case:
    """API, columns of blanks whose names have blanks"""
    s = session("ur10", 36, 32)
    head = "  ".join(["Point Name", *names("Joint {}"), "Meas X", "Meas Y", "Meas Z"])
    rows = ["  ".join(f"{v:>12}" for v in row) for row in np.column_stack([s.no, s.q, s.p])]
    return Case((write(folder / "radian.txt", ["Radian, 2024", "", head, *rows]),), s.arm, s)


def creaform(folder: Path) -> Case:
    """Creaform VXtrack, position and Euler angles, units in parentheses without a blank"""
    s = session("ur10", 40, 33)
    head = ["Time(s)", *(f"T{a}(mm)" for a in "XYZ"), *(f"R{a}(deg)" for a in "XYZ"), *names("A{}(deg)")]
    rows = table(0.2 * s.no, s.p, np.round(s.turn.as_euler("xyz", degrees=True), 4), s.q, by="\t")
    return Case((write(folder / "vx.txt", ["\t".join(head), *rows]),), s.arm, s)


def nikon(folder: Path) -> Case:
    """Nikon K-series, two diodes one below the other; joints by the number of the pose"""
    s = session("irb6400r", 40, 34)
    rows = [f"{k};{led};{joined}" for k, p, r in zip(s.no, s.p, s.second, strict=True)
            for led, joined in (("LED1", ";".join(map(str, p))), ("LED2", ";".join(map(str, r))))]  # fmt: skip
    pose = write(folder / "q.csv", [f"Pose,{AXES}", *table(s.no, s.q)])
    return Case((pose, write(folder / "kcmm.csv", ["Pose;Diode;X;Y;Z", *rows])), s.arm, s, 2)


def vicon(folder: Path) -> Case:
    """Vicon, names and units in two lines, rotation vectors; joints in a second file"""
    s = session("ur10", 40, 35)
    head = ["Objects", "100", ",,Tool:Tool,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,rad,rad,rad,mm,mm,mm"]
    rows = table(s.no, 0, np.round(s.turn.as_rotvec(), 6), s.p)
    return Case((write(folder / "q.csv", [AXES, *table(s.q)]), write(folder / "vicon.csv", [*head, *rows])), s.arm, s)


def yaskawa(folder: Path) -> Case:
    """Yaskawa, axes S L U R B T"""
    s = session("ur10", 40, 36)
    return Case((write(folder / "p.csv", ["No,S,L,U,R,B,T,X,Y,Z", *table(s.no, s.q, s.p)]),), s.arm, s)


def staubli(folder: Path) -> Case:
    """Staeubli, a list of joints in braces; points in a second file"""
    s = session("irb6400r", 40, 37)
    joints = [f"  jPoint[{k}] = {{{row}}}" for k, row in zip(s.no, table(s.q), strict=True)]
    return Case((write(folder / "list.dtx", joints), write(folder / "p.csv", ["x,y,z", *table(s.p)])), s.arm, s)


def kuka_points(folder: Path) -> Case:
    """KUKA, axes and points of the controller in two files"""
    s = session("ur10", 40, 38)
    abc = np.round(s.own_turn.as_euler("ZYX", degrees=True), 4)
    parts = [part for k, v in enumerate("XYZ") for part in (v, s.own[:, k])]
    parts += [part for k, v in enumerate("ABC") for part in (v, abc[:, k])]
    points = [f"DECL E6POS XP{k}={{{row},S 2,T 35}}" for k, row in zip(s.no, table(*parts, by=" "), strict=True)]
    pose = write(folder / "axes.csv", ["A1,A2,A3,A4,A5,A6", *table(s.q)])
    return Case((pose, write(folder / "cal.dat", ["DEFDAT CAL", *points, "ENDDAT"])), s.arm, None)


def stations(folder: Path) -> Case:
    """A tracker at two stations"""
    s = session("irb6400r", 50, 39)
    moved = s.p.copy()
    moved[25:] = np.round(Rotation.from_rotvec([0.1, 0.2, 1.0]).apply(s.p[25:]) + np.array([900.0, -400.0, 30.0]), 4)
    station = ["S1"] * 25 + ["S2"] * 25
    return Case(
        (write(folder / "t.csv", [f"Station,{AXES},X,Y,Z", *table(station, s.q, moved)]),), s.arm, replace(s, p=moved)
    )


def quoted(folder: Path) -> Case:
    """Decimal commas in quotes, commas between them"""
    s = session("ur10", 40, 40)
    rows = [",".join(f'"{cell}"'.replace(".", ",") for cell in row.split(";")) for row in table(s.q, s.p, by=";")]
    return Case((write(folder / "t.csv", [f'"{AXES},X,Y,Z"'.replace(",", '","'), *rows]),), s.arm, s)


def inches(folder: Path) -> Case:
    """Inches by the name"""
    s = session("irb6400r", 40, 41)
    head = [*names("joint_{}_deg"), "x_in", "y_in", "z_in"]
    return Case((write(folder / "t.csv", [",".join(head), *table(s.q, np.round(s.p / 25.4, 6))]),), s.arm, s)


def gaps(folder: Path) -> Case:
    """Points that were not seen, as zeros and as texts; a line of means below"""
    s = session("ur10", 45, 42)
    cells = s.p.astype(object)
    cells[5], cells[9] = "n/a", 0.0
    truth = s.p.copy()
    truth[[5, 9]] = np.nan
    rows = table(s.no, s.q, cells)
    return Case(
        (write(folder / "t.csv", [f"No,{AXES},X,Y,Z", *rows, "", "mean,,,,,,,1.5,2.5,3.5"]),),
        s.arm,
        replace(s, p=truth),
    )


def stream(folder: Path) -> Case:
    """A log of joints ten times a pose; points by the clock"""
    s = session("ur10", 40, 43)
    clock = pd.Timestamp("2024-02-03T10:00:00") + pd.to_timedelta(np.arange(400) * 500, unit="ms")
    log = write(
        folder / "log.csv",
        [f"stamp,{AXES}", *table([f"{t.isoformat()}" for t in clock], np.repeat(radians(s), 10, axis=0))],
    )
    seen = [f"{(clock[10 * k + 5] + pd.Timedelta('100ms')).isoformat(sep=' ')}" for k in range(40)]
    return Case((log, write(folder / "p.csv", ["Measured at;X;Y;Z", *table(seen, s.p, by=";")])), s.arm, s)


def home_first(folder: Path) -> Case:
    """Two points before the first pose; nothing names the rows"""
    s = session("irb6400r", 40, 44)
    before = s.p[:2] + np.array([3000.0, 100.0, -500.0])
    points = write(folder / "p.txt", table(np.vstack([before, s.p]), by="\t"))
    return Case((write(folder / "q.txt", table(s.q, by="\t")), points), s.arm, s)


def other_way(folder: Path) -> Case:
    """An axis counted the other way round"""
    s = session("ur10", 40, 45)
    return Case((write(folder / "t.csv", [f"{AXES},X,Y,Z", *table(s.q * [1, 1, 1, 1, -1, 1], s.p)]),), s.arm, s)


def two_sheets(folder: Path) -> Case:
    """Excel, joints and points on two sheets"""
    s = session("irb6400r", 40, 46)
    with pd.ExcelWriter(folder / "book.xlsx") as book:
        pd.DataFrame(s.q, columns=names("J{} [deg]")).to_excel(book, sheet_name="joints", index=False)
        pd.DataFrame(s.p, columns=["X [mm]", "Y [mm]", "Z [mm]"]).to_excel(book, sheet_name="points", index=False)
    return Case((folder / "book.xlsx",), s.arm, s)


def lying(folder: Path) -> Case:
    """Metres under a header that says mm"""
    s = session("ur10", 40, 47)
    head = [*names("J{} [deg]"), "x [mm]", "y [mm]", "z [mm]"]
    return Case((write(folder / "t.csv", [",".join(head), *table(s.q, np.round(1e-3 * s.p, 7))]),), s.arm, None)


def json_lines(folder: Path) -> Case:
    """A JSON object a line"""
    s = session("ur10", 40, 48)
    rows = [json.dumps({"q": q.tolist(), "p": p.tolist()}) for q, p in zip(radians(s), s.p, strict=True)]
    return Case((write(folder / "log.jsonl", rows),), s.arm, s)


def commanded(folder: Path) -> Case:
    """Two sets of joint values whose names do not tell which was measured"""
    s = session("irb6400r", 40, 49)
    near = np.round(s.q + 0.01 * np.random.default_rng(49).normal(size=s.q.shape), 4)
    head = ",".join([*names("A{}"), *names("B{}"), *"XYZ"])
    return Case((write(folder / "t.csv", [head, *table(s.q, near, s.p)]),), s.arm, None)


def coarse(folder: Path) -> Case:
    """A tenth of a millimetre, thousands with commas in quotes"""
    s = session("ur10", 40, 50)
    shown = np.round(s.p + 0.1 * np.random.default_rng(50).normal(size=s.p.shape), 1)
    rows = [
        f"{q},{p}" for q, p in zip(table(s.q), [",".join(f'"{v:,.1f}"' for v in row) for row in shown], strict=True)
    ]
    return Case((write(folder / "t.csv", [f"{AXES},X,Y,Z", *rows]),), s.arm, replace(s, p=shown))


LATER = (
    faro, api, creaform, nikon, vicon, yaskawa, staubli, kuka_points, stations, quoted, inches, gaps, stream,
    home_first, other_way, two_sheets, lying, json_lines, commanded, coarse,
)  # fmt: skip
