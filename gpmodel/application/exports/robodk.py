"""Rows of RoboDK's table of a robot: modified Denavit-Hartenberg, and its base and tool frame.

    H = base · Π rotx(rx) transl(tx, 0, tz) rotz(rz) · tool,    rz (tz of a prismatic joint) + the motion of the joint

Sources: `dhm` and `xyzrpw_2_pose` of robodk.robomath, RoboDK API 6. There is no fifth number for nearly parallel axes:
their common normal lies far away, with the same motion in between.
"""

from collections.abc import Mapping

import numpy as np

from gpmodel.application.exports.chain import Chain
from gpmodel.application.exports.dh import Across, across, along_z
from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics import se3

PARALLEL = 1e-9
"""Radians up to which axes are written as parallel: at two metres 2 nm."""


def robodk_text(mechanism: Mechanism, chain: Chain, twists: Mapping[str, Array], note: str) -> str:
    """CSV of a chain with constant error twists (6,), m and rad, by slot: rx, rz in deg, tx, tz in mm, and the motion
    that is added, in table coordinates. note: its first comment."""
    base, between, tool = along_z(chain, twists)
    steps = [across(frame, PARALLEL) for frame in between]
    lines = [f"# {line}" for line in note.splitlines()]
    lines += ["# H = base * rotx(rx) transl(tx, 0, tz) rotz(rz) of every row * tool; the motion is added to rz or tz"]
    lines += [_frame("base", base), _frame("tool", tool), "motion,rx [deg],tx [mm],tz [mm],rz [deg]"]
    for weights, before, after in zip(chain.motions, [Across(), *steps], [*steps, Across()], strict=True):
        terms = zip(weights.tolist(), mechanism.joints, strict=True)
        motion = " ".join(f"{w:+g}*{joint.name}" for w, joint in terms if w)
        angles = np.degrees([before.alpha, before.next_turn + after.turn])
        lengths = 1e3 * np.array([before.a, before.next_slide + after.slide])
        lines.append(",".join([motion, *(repr(float(v)) for v in (angles[0], *lengths, angles[1]))]))
    return "\n".join(lines) + "\n"


def _frame(name: str, frame: Array) -> str:
    """X, Y, Z, mm, R, P, W, deg: transl(x, y, z) rotz(w) roty(p) rotx(r)."""
    numbers = [*(1e3 * frame[:3, 3]), *np.degrees(se3.roll_pitch_yaw(frame[:3, :3]))]
    return f"# {name}, x y z r p w: {' '.join(repr(float(v)) for v in numbers)}"
