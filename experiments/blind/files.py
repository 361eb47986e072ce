"""Write the files of a blind robot: description, table, new poses, true values."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments.blind.judge import judge
from experiments.blind.robot import Robot, Sheet
from experiments.blind.session import UNITS
from experiments.blind.simulator import Arm, Array


def rpy(rotation: Array) -> tuple[float, float, float]:
    """Fixed-axis roll, pitch, yaw of URDF: Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return float(roll), float(pitch), float(yaw)


def urdf(arm: Arm, masses: bool = True) -> str:
    """The nominal arm as URDF: masses and centres of mass if wanted, no meshes, limits wider than the poses."""
    text = [f'<?xml version="1.0"?>\n<robot name="{arm.name}">\n  <link name="base"/>']
    for i, (mass, centre, origin) in enumerate(zip(arm.masses, arm.centres, arm.origins(), strict=True)):
        slides = i + 1 in arm.prismatic
        low, high = arm.limits[i] + (np.array([-0.1, 0.1]) if slides else np.radians([-5.0, 5.0]))
        parent = "base" if i == 0 else f"link_{i}"
        xyz = " ".join(f"{v:.12g}" for v in origin[:3, 3])
        angles = " ".join(f"{v:.15g}" for v in rpy(origin[:3, :3]))
        inertia = 0.01 * mass
        inertial = (
            f'>\n    <inertial>\n      <origin xyz="{centre[0]:.9g} {centre[1]:.9g} {centre[2]:.9g}" rpy="0 0 0"/>\n'
            f'      <mass value="{mass:.9g}"/>\n'
            f'      <inertia ixx="{inertia:.9g}" ixy="0" ixz="0" iyy="{inertia:.9g}" iyz="0" izz="{inertia:.9g}"/>\n'
            f"    </inertial>\n  </link>\n"
        )
        text.append(
            f'  <link name="link_{i + 1}"{inertial if masses else "/>" + chr(10)}'
            f'  <joint name="J{i + 1}" type="{"prismatic" if slides else "revolute"}">\n'
            f'    <parent link="{parent}"/>\n    <child link="link_{i + 1}"/>\n'
            f'    <origin xyz="{xyz}" rpy="{angles}"/>\n    <axis xyz="0 0 1"/>\n'
            f'    <limit lower="{low:.9g}" upper="{high:.9g}" effort="1000" velocity="3"/>\n  </joint>'
        )
    return "\n".join([*text, "</robot>\n"])


WALK = {
    "kind": "instrument_walk", "settings": {}, "size_mm": 0.0, "amount": 1.0, "constants": {},
    "named": [["row"], ["time"], ["*tracker*"], ["*instrument*"]],
    "called": ["*walk*", "*drift*", "*tracker*", "*instrument*"],
    "place": "instrument", "hidden": True,
}  # fmt: skip


def table(arm: Arm, sheet: Sheet, positions: Array | None, labelled: bool = False) -> str:
    """CSV with units in the header; labelled: with a column `repeat` that says which rows are of one pose."""
    prismatic = arm.prismatic
    names = [f"J{i} [{'mm' if i in prismatic else 'deg'}]" for i in range(1, len(arm.rows) + 1)]
    names += [f"{name} [{'N*m' if name.startswith('torque') else UNITS.get(name, '1')}]" for name in sheet.extra]
    values = [1e3 * v if i + 1 in prismatic else np.degrees(v) for i, v in enumerate(sheet.q.T)]
    forms = ["%.4f"] * len(values) + ["%g" if name != "time" else "%.8g" for name in sheet.extra]
    values += list(sheet.extra.values())
    if labelled:
        names, forms, values = [*names, "repeat"], [*forms, "p%d"], [*values, sheet.pose]
    if positions is not None:
        names += ["x [mm]", "y [mm]", "z [mm]"]
        values += list(1e3 * positions.T)
        forms += ["%.5f"] * 3
    line = ",".join(forms)
    return "\n".join([",".join(names), *(line % row for row in zip(*values, strict=True)), ""])


def write(robot: Robot, folder: Path, judged: bool = False) -> dict[str, Any]:
    """robot.urdf, table.csv, truth.json; fresh_K.csv without and fresh_K_clean.csv, _noisy.csv with positions.

    beyond_K is the same for poses outside the range of the table; judged: fits the geometric model and the oracle, too,
    puts their errors into the truth and the points of the former into fresh_K_standard.csv (a second or a few).
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf(robot.arm, masses=robot.case.masses != "none"))
    (folder / "table.csv").write_text(table(robot.arm, robot.train, robot.train.measured, robot.case.labelled))
    sheets = {f"fresh_{k}": sheet for k, sheet in enumerate(robot.fresh)}
    sheets |= {f"beyond_{k}": sheet for k, sheet in enumerate(robot.beyond)}
    for name, sheet in sheets.items():
        (folder / f"{name}.csv").write_text(table(robot.arm, sheet, None))
        (folder / f"{name}_clean.csv").write_text(table(robot.arm, sheet, sheet.clean))
        (folder / f"{name}_noisy.csv").write_text(table(robot.arm, sheet, sheet.measured))
    truth = truth_of(robot)
    if judged:
        judgement = judge(robot)
        truth["errors"] = judgement.errors
        for (name, sheet), positions in zip(sheets.items(), judgement.standard, strict=True):
            (folder / f"{name}_standard.csv").write_text(table(robot.arm, sheet, positions))
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return truth


def truth_of(robot: Robot) -> dict[str, Any]:
    """Everything that was drawn and that a report can be compared with.

    hidden: an effect that leaves nothing to find after the geometric model, or is noise; by_row: as in Robot.
    """
    walk = [WALK] if robot.case.walk_mm else []
    return {
        "case": {k: v for k, v in asdict(robot.case).items() if k != "effects"},
        "seed": robot.seed,
        "effects": [
            {
                "kind": kind, "settings": settings, "size_mm": target, "amount": amount, "constants": shape.constants,
                "named": shape.named, "called": shape.called, "place": shape.place, "hidden": target == 0.0,
            }
            for (kind, settings, target), shape, amount in zip(
                robot.case.effects, robot.shapes, robot.amounts, strict=True
            )
        ] + walk,
        "by_row": robot.by_row,
        "outliers": robot.train.outliers.tolist(),
        "fresh": [f"fresh_{k}" for k in range(len(robot.fresh))],
        "beyond": [f"beyond_{k}" for k in range(len(robot.beyond))],
        "poses_fresh": sum(len(s.q) for s in robot.fresh),
    }  # fmt: skip
