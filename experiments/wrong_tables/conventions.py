"""Count the wrong conventions that `gpmodel check` names with the cure.

A convention is named if a remark matches the cure. From the root of the repository:
python -m experiments.wrong_tables.conventions [--robots 10] [--only KIND] [--out FOLDER]
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from experiments.options import parsed
from experiments.wrong_tables.kinds import ARMS, KINDS, Change, Table, column, joints, measured, part, points, turned
from experiments.wrong_tables.run import OFFSETS, judged
from gpmodel.files import to_json, write_text

HERE = Path(__file__).parent
NEW: dict[str, Change] = {
    "J1, J4, J6 flipped": joints(lambda q: part(q, (slice(None), [0, 3, 5]), np.negative)),
    "joints in reverse order": joints(lambda q: q[:, ::-1].copy()),
    "zero of J2 off by 90 deg": column(1, lambda x: x - np.pi / 2),
    "zeros of J2, J3 off by -90, 90 deg": joints(lambda q: q + np.pi / 2 * np.eye(q.shape[1])[[1, 2]].T @ [-1.0, 1.0]),
    "J2 flipped, its zero off by 90 deg": column(1, lambda x: -x - np.pi / 2),
    "joints in degrees under [rad]": joints(np.degrees),
    "points in mm under [m]": points(lambda p, _: 1e3 * p),
    "two set-ups, J2 zeroed between": joints(lambda q: part(q, (slice(30, None), 1), lambda x: x + np.radians(5))),
    "Euler ZYX, angles of z, y, x": turned(lambda r: r.as_euler("ZYX")),
    "Euler ZYZ": turned(lambda r: r.as_euler("ZYZ")),
    "Euler XYZ": turned(lambda r: r.as_euler("XYZ")),
    "rotation vectors in rad under [deg]": turned(lambda r: np.radians(r.as_rotvec())),
    "Euler ZYX in rad under [deg]": turned(lambda r: np.radians(r.as_euler("ZYX"))),
    "rotation of a left-handed frame": turned(lambda r: r.as_rotvec() * [1.0, -1.0, -1.0]),
}
CURES = {
    **{f"J{k} flipped": rf"column '{{J{k}}}' probably has the opposite sign" for k in (1, 2, 4)},
    "last joint flipped": "column '{J-1}' probably has the opposite sign",
    "J1, J4, J6 flipped": "'{J1}', '{J4}'.* probably have the opposite sign",
    "J2, J3 swapped": "columns '{J2}' and '{J3}' look swapped",
    "J4, J6 swapped": "columns '{J4}' and '{J6}' look swapped",
    "joints in reverse order": "reverse order",
    "J3 + J2": "'{J3}' should probably be '{J3}' - '{J2}'",
    "J3 - J2": r"'{J3}' should probably be '{J3}' \+ '{J2}'",
    "zero of J2 off by 90 deg": r"be '{J2}' \+ 90 deg: the description has another joint zero",
    "zeros of J2, J3 off by -90, 90 deg": r"be '{J2}' \+ 90 deg and .* be '{J3}' - 90 deg",
    "J2 flipped, its zero off by 90 deg": "be -'{J2}' - 90 deg",
    "joints in radians under [deg]": r"write \[rad\] in the headers",
    "J5 in radians under [deg]": r"column '{J5}' looks like \[rad\]",
    "joints in degrees under [rad]": r"write \[deg\] in their headers",
    "points in m under [mm]": r"\[m\] given as \[mm\]",
    "points in mm under [m]": r"\[mm\] given as \[m\]",
    "points in inches under [mm]": r"\[in\] given as \[mm\]",
    "x, y swapped": "two of the columns x, y, z look swapped",
    "z mirrored": "one has the wrong sign",
    "description in mm": "millimetres written where metres are meant",
    "points one row late": "belongs to the pose before",
    "reading 20 lost": "from about row .* a row was lost",
    "J4 one row late": "column '{J4}' is probably a row late",
    "controller's positions, 3 decimals": "computed",
    "controller's positions, 2 decimals, no tool": "computed",
    "every third row of a tool 30 mm longer": "two set-ups or tools in one table",
    "two stands, 300 mm apart": "two set-ups or tools in one table",
    "rotations as Euler angles xyz": "as fixed XYZ of",
    "Euler XYZ": "as intrinsic XYZ of rx, ry, rz",
    "Euler ZYX, angles of z, y, x": "as intrinsic ZYX of rx, ry, rz",
    "Euler ZYZ": "as intrinsic ZYZ of rx, ry, rz",
    "rotations as the inverse": "as the inverse",
    "quaternions wxyz read as xyzw": "as quaternion",
    "rotation vectors in rad under [deg]": "as rotation vector in radians",
    "Euler ZYX in rad under [deg]": "as intrinsic ZYX of rx, ry, rz in radians",
    "rotation of a left-handed frame": "left-handed",
}


def named(table: Table, kind: str, seed: int) -> tuple[bool, list[str]]:
    """Return whether the message names the cure, and the message."""
    wrong = (KINDS | NEW)[kind](table, np.random.default_rng([seed, list(CURES).index(kind)]))
    _, said = judged(wrong)
    names = [joint.name for joint in table.mechanism.joints]
    cure = re.sub(r"\{J(-?\d)\}", lambda m: re.escape(names[int(m[1]) - (int(m[1]) > 0)]), CURES[kind])
    return any(re.search(cure, text) for text in said), said


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    given = parsed(__doc__, arguments, robots=len(ARMS), only="", out=HERE)
    rows: dict[str, list[str]] = {kind: [] for kind in CURES if given.only in kind}
    for seed, arm in enumerate(ARMS[: given.robots]):
        table = measured(arm, seed, offset=OFFSETS[seed % 2])
        for kind in rows:
            right, said = named(table, kind, seed)
            rows[kind] += [] if right else [arm]
            print(arm, "|", kind, "|", "named" if right else f"not named: {[s[:250] for s in said]}", flush=True)
    everywhere = sum(not arms for arms in rows.values())
    results = {"command": f"python -m experiments.wrong_tables.conventions --robots {given.robots}",
               "kinds": len(rows), "named on every arm": everywhere, "not named on": rows}  # fmt: skip
    if not given.only:
        write_text(given.out / "conventions.json", to_json(results))
    print(f"{everywhere} of {len(rows)} kinds named on every one of {given.robots} arms")
    return results


if __name__ == "__main__":
    main()
