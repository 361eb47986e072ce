"""Distance of each export from `gpmodel predict` at the joint values of the controller.

First simulated arms with two effects beside their geometry, 80 poses, a calibration with the effects named; the rows
are those of the page. Then arms of every kind with geometric errors alone, so that a file is either predict to a
micrometre or refused; calibrated.urdf is also read by Pinocchio. This command writes the tables of README.md. From the
root of the repository: python -m experiments.exports.run
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.exports.geometry import ARMS, GEOMETRY, HERE, NOISE, POSES, geometry, worst
from gpmodel.files import to_json, write_text

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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE)
    parser.add_argument("--arms", type=int, default=len(ARMS), help="How many of the second table.")
    given = parser.parse_args(arguments)
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
