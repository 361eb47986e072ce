"""Measure the distance of each export from `gpmodel predict` at the joint values of the controller.

First, simulated arms with two effects in addition to their geometry, 80 poses, a calibration with the effects named;
one row per file. Then arms of every kind with geometric errors alone, whose files agree with predict to a micrometre or
are refused; Pinocchio also reads calibrated.urdf. This command writes the tables of README.md. From the
root of the repository: python -m experiments.exports.run
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import gpmodel as gp
from experiments.options import parsed
from gpmodel.application.exports.make import Exports, merged, parts_of
from gpmodel.application.exports.programs import LANGUAGES, program_read
from gpmodel.application.exports.rigid import measured_link
from gpmodel.application.exports.sample import Place, fresh_poses
from gpmodel.arrays import Array
from gpmodel.files import to_json, write_text
from gpmodel.numerics import se3
from gpmodel.table.cells import joint_table
from gpmodel.table.dataset import Dataset
from gpmodel.table.robot_programs import AXES, fields_of
from robots.library import EXAMPLE_ARMS

HERE, POINT = Path(__file__).parent, ["x [mm]", "y [mm]", "z [mm]"]
POSES, NOISE, GEOMETRY = 80, "0.03 mm", "0.3 mm"
ARMS = ("irb6400r", "irb6400r-2.8", *EXAMPLE_ARMS, "wrist.toml", "mimic.urdf", "two_arms.toml")
"""With a parallel bar; of one joint a motor; with a coupled wrist; with a mimic joint; of two arms."""


def geometry(arm: str) -> dict[str, float | str | None]:
    """By file its largest error, µm, or why there is none; of a URDF by Pinocchio, too."""
    path = str(HERE / arm) if (HERE / arm).is_file() else arm
    several = arm == "two_arms.toml"
    instrument = "points" if several else "tracker"
    made = gp.simulate(path, poses=POSES, noise=NOISE, geometry_sigma=GEOMETRY, instrument=instrument)
    model = gp.calibrate(path, made.table, holdout=0).model
    saved, constant = model.saved, [e.constant for e in model.saved.model.effects]
    saved = replace(saved, theta=np.where(constant, saved.theta, 0.0))  # touches add functions, which few files hold
    exports = merged([part() for part in parts_of(saved, Place.of(saved))[:-1]])
    found = {e.file: None if np.isnan(e.largest) else 1e6 * e.largest for e in exports.files}
    if not several:
        found["calibrated.urdf by Pinocchio"] = by_pinocchio(model, exports)
        found |= programs(model)
    print(arm, found, sep="\n", flush=True)
    return {**found, **exports.refused}


def by_pinocchio(model: gp.Model, exports: Exports) -> float:
    """Largest distance of calibrated.urdf from predict, µm, its mimic joints moved by Pinocchio."""
    text = next(e.text for e in exports.files if e.file == "calibrated.urdf")
    placed, poses = model.saved.placement, fresh_poses(model.saved, 100, np.random.default_rng(1))
    tips = (placed.registration[""] @ pinocchio_frames(text, measured_link(text), poses) @ placed.tool[""])[:, :3, 3]
    wanted = model.predict(joint_table(model.mechanism, poses.q))
    return float(1e6 * np.linalg.norm(tips - wanted[POINT].to_numpy() / 1e3, axis=1).max())


def pinocchio_frames(urdf: str, link: str, poses: Dataset) -> Array:
    """The frame (N, 4, 4) of a link in the root at poses as Pinocchio has it, which reads <mimic>."""
    arm = pin.buildModelFromXML(urdf, mimic=True)
    data, at, frames = arm.createData(), arm.getFrameId(link, pin.FrameType.BODY), []
    for row in poses.q:
        q = pin.neutral(arm)
        for name, value in zip(poses.joints, row, strict=True):
            joint = arm.joints[arm.getJointId(name)]
            q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pin.framesForwardKinematics(arm, data, q)
        frames.append(data.oMf[at].homogeneous)
    return np.array(frames)


def programs(model: gp.Model) -> dict[str, float | str]:
    """Distance, µm, of predict at the joint values read in a program from that at corrected targets, or its frames."""
    poses = fresh_poses(model.saved, 50, np.random.default_rng(2))
    joints, found = model.mechanism.joints, dict[str, float | str]()
    corrected = model.compensate(joint_table(model.mechanism, poses.q))
    there = corrected.filter(like="corrected_").dropna()
    wanted = model.predict(there.rename(columns=lambda header: header.removeprefix("corrected_")))[POINT].to_numpy()
    for language in LANGUAGES:
        try:
            values, frames = program_read(model.program(corrected, language))
        except gp.InputError as error:
            found[f"program in {language}"] = error.said
            continue
        scales = [1e3 if j.kind == "prismatic" else np.degrees(1.0) for j in joints]
        fields = fields_of(model.mechanism, None)
        places = [AXES * (field[0] == "E") + int(field[1]) - 1 for field in fields]
        q = np.array([values[row + 1] for row in there.index])[:, places] / scales
        here = np.array([frames[row + 1][:3, 3] for row in there.index])
        off = here - se3.chain(model.mechanism.transforms(q))[-1][:, :3, 3]
        apart = model.predict(joint_table(model.mechanism, q))[POINT].to_numpy() - wanted
        found[f"program in {language}"] = float(np.linalg.norm([1e6 * off, 1e3 * apart], axis=2).max())
    return found


def worst(arms: dict[str, dict[str, float | str | None]]) -> str:
    """By file the worst of all arms, and of how many it is refused."""
    lines = ["| geometry alone | arms | worst, µm | refused |", "|---|---|---|---|"]
    for file in dict.fromkeys(file for found in arms.values() for file in found):
        known = [found[file] for found in arms.values() if file in found]
        numbers = [v for v in known if isinstance(v, float)]
        refused = sum(isinstance(v, str) for v in known)
        lines.append(
            f"| `{file}` | {len(known) - refused} | {f'{max(numbers):.1g}' if numbers else '–'} | {refused or ''} |"
        )
    return "\n".join(lines)


CASES = {
    "irb6400r": {"joint_compliance J2": "2e-7", "gear_harmonic J4": "60 arcsec"},
    "ur5": {"base_compliance": "2e-6", "gear_harmonic elbow_joint": "60 arcsec"},
    "panda": {"joint_compliance panda_joint4": "4e-6", "gear_harmonic panda_joint1": "60 arcsec"},
}
"""Arms, and the effects that are true."""


def study(arm: str, effects: dict[str, str]) -> list[dict[str, Any]]:
    """A row an export."""
    made = gp.simulate(
        arm, [f"{n}={v}" for n, v in effects.items()], poses=POSES, noise=NOISE, geometry_sigma=GEOMETRY, seed=0
    )
    exports = gp.calibrate(arm, made.to_dataframe(), list(effects)).model.export()
    print(arm, exports.summary(), sep="\n", flush=True)
    rows = exports.to_dataframe()[["file", "RMS [mm]", "max [mm]", "held-out RMS [mm]"]]
    return rows.replace({np.nan: None}).to_dict("records")


def cell(row: dict[str, Any]) -> str:
    """RMS (largest), mm."""
    rms, most = (None if row[k] is None else f"{row[k]:.3f}" if row[k] > 1e-3 else f"{row[k]:.0e}"
                 for k in ("RMS [mm]", "max [mm]"))  # fmt: skip
    return f"{rms} ({most})" if rms else f"({most})" if most else "–"


def table(studies: dict[str, list[dict[str, Any]]]) -> str:
    """The studies as Markdown."""
    rows: dict[str, dict[str, str]] = {}
    for arm, study_rows in studies.items():
        for row in study_rows:
            rows.setdefault(row["file"], {})[arm] = cell(row)
    lines = [f"| mm, RMS (largest) | {' | '.join(studies)} |", "|---" * (1 + len(studies)) + "|"]
    for file, cells in rows.items():
        lines.append(f"| `{file}` | {' | '.join(cells.get(arm, 'refused') for arm in studies)} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    given = parsed(__doc__, arguments, out=HERE, arms=len(ARMS))
    results = {"command": "python -m experiments.exports.run", "effects": CASES,
               "studies": {arm: study(arm, effects) for arm, effects in CASES.items()},
               "geometry": {arm: geometry(arm) for arm in ARMS[: given.arms]}}  # fmt: skip
    write_text(given.out / "results.json", to_json(results))
    readme = given.out / "README.md"
    if readme.is_file():
        head = readme.read_text(encoding="utf-8").partition("| geometry alone")[0]
        write_text(readme, f"{head}{worst(results['geometry'])}\n\n{table(results['studies'])}\n")
    return results


if __name__ == "__main__":
    main()
