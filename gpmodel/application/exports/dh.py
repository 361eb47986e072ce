"""Write a calibrated chain as Denavit-Hartenberg rows, in a TOML file for `--mechanism`, or as RoboDK's table.

    modified:  Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)        standard:  Rz(theta) Tz(d) Rx(alpha) Tx(a) Ry(beta)

beta is zero except between nearly parallel axes, whose common normal is ill-defined. Between nearly parallel axes, the
length a lies in the plane perpendicular to the first axis and ends at the second axis. A format with four columns has
no beta and cannot express nearly parallel axes. Source: Craig (1986); Hayati and Mirmirani (1985).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.application.exports.forward import Chain
from gpmodel.arrays import ROUNDING, Array
from gpmodel.characters import commented, harmless
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Joint, Mechanism
from gpmodel.numerics import se3

Convention = Literal["standard", "modified"]

NEARLY_PARALLEL = np.radians(1.0)
"""Angle between axes, rad, below which the DH parameter beta is used. Below this angle an error of 0.1 mrad moves the
common normal of axes a metre apart by more than 6 mm."""
FAR = 10.0
"""Largest distance of two axes' common normal from their frames, m. At 10 m, 1 µm at the tool needs angles with six
decimals of a degree, the usual format of tables. A limit of 5 m refuses some arms of 3 m; a limit of 20 m needs seven
decimals."""
ALONGSIDE = np.radians(45.0)
"""Angle between two axes, rad, above which a distant common normal is caused by a long rail and accepted."""


@dataclass(frozen=True)
class Across:
    """Transform from one joint axis to the next: Rz(turn) Tz(slide) Rx(alpha) Tx(a) Ry(beta) Rz(next_turn)
    Tz(next_slide), rad, m."""

    turn: float = 0.0
    slide: float = 0.0
    alpha: float = 0.0
    a: float = 0.0
    beta: float = 0.0
    next_turn: float = 0.0
    next_slide: float = 0.0


def across(frame: Array, parallel: float = NEARLY_PARALLEL) -> Across:
    """Decompose a transform (4, 4) between two frames, each with its axis along z.

    parallel: angle between the axes, rad, below which beta is used. Beta also replaces a common normal beyond FAR.
    """
    angle = tilt(frame)
    found = _hayati(frame) if angle < parallel else _normal(frame)
    far = max(abs(found.slide), abs(found.next_slide)) > FAR and angle < ALONGSIDE
    return _hayati(frame) if far else found


def tilt(frame: Array) -> float:
    """Return the angle between the z axes of two frames, rad, at most a quarter turn."""
    direction = frame[:3, 2]
    return float(np.arctan2(np.hypot(direction[0], direction[1]), abs(direction[2])))


def _hayati(frame: Array) -> Across:
    rotation, point = frame[:3, :3], frame[:3, 3]
    direction = rotation[:, 2]
    slide = point[2] / direction[2]
    foot = point - slide * direction
    turn = float(np.arctan2(foot[1], foot[0]))
    left = _about_z(-turn) @ rotation
    beta, alpha = float(np.arcsin(left[0, 2])), float(np.arctan2(-left[1, 2], left[2, 2]))
    rest = Rotation.from_euler("XY", [alpha, beta]).as_matrix().T @ left
    return Across(turn, 0.0, alpha, float(np.hypot(*foot[:2])), beta, _angle(rest), float(slide))


def _normal(frame: Array) -> Across:
    rotation, point = frame[:3, :3], frame[:3, 3]
    direction = rotation[:, 2]
    normal = np.array([-direction[1], direction[0], 0.0])
    normal *= np.sign(normal[0]) or 1.0
    normal /= np.linalg.norm(normal)
    slide, a, next_slide = np.linalg.solve(np.column_stack([[0.0, 0.0, 1.0], normal, direction]), point)
    turn = float(np.arctan2(normal[1], normal[0]))
    left = _about_z(-turn) @ rotation
    alpha = float(np.arctan2(-left[1, 2], left[2, 2]))
    rest = Rotation.from_euler("X", alpha).as_matrix().T @ left
    return Across(turn, float(slide), alpha, float(a), 0.0, _angle(rest), float(next_slide))


def dh_text(mechanism: Mechanism, chain: Chain, twists: Mapping[str, Array], convention: Convention, note: str) -> str:
    """Write a chain with constant error twists, m and rad, by frame (slot), as DH rows in TOML. note: first comment.

    Raises InputError if a joint drives its motion by a factor other than 1 or -1, or drives two motions.
    """
    joints = mechanism.joints
    base, between, tool = along_z(chain, twists)
    steps = [across(frame) for frame in between]
    before, after = [Across(), *steps], [*steps, Across()]
    lines = commented(note)
    lines += [f'name = "{harmless(mechanism.name)}"', f'convention = "{convention}"', "", *_placed("base", base), ""]
    lines += [*_placed("tool", tool), ""]
    own, follows = _couplings(chain, joints)
    for i, joint in enumerate(joints):
        row = before[i] if convention == "modified" else after[i]
        turn, slide = before[i].next_turn + after[i].turn, before[i].next_slide + after[i].slide
        lines += ["[[joint]]", f'name = "{joint.name}"', f'kind = "{joint.kind}"']
        lines += [f"alpha_deg = {_degrees(row.alpha)}", f"a_mm = {1e3 * row.a!r}"]
        lines += [f"beta_deg = {_degrees(row.beta)}"] if row.beta else []
        lines += [f"theta_deg = {_degrees(turn)}", f"d_mm = {1e3 * slide!r}", f"sign = {own[i]}", *_limits(joint), ""]
    for i, j, factor in follows:
        lines += ["[[coupling]]", f'joint = "{joints[i].name}"', f'follows = "{joints[j].name}"', f"factor = {factor}"]
        lines += [""]
    return "\n".join(lines)


def along_z(chain: Chain, twists: Mapping[str, Array]) -> tuple[Array, list[Array], Array]:
    """Return the constant transforms before the first joint motion, between motions and after the last, with all axes
    along z."""
    fixed, pending = [], np.eye(4)
    for slot, frame, axis in zip(chain.slots, chain.fixed, chain.axes, strict=True):
        pending = pending @ frame
        if axis:
            turn = np.eye(4)
            turn[:3, :3] = np.roll(np.eye(3), AXES.index(axis) % 3 - 2, axis=0)
            fixed.append(pending @ turn)
            pending = turn.T
        pending = pending @ se3.exp(twists.get(slot, np.zeros(6)))
    return fixed[0], fixed[1:], pending


def _couplings(chain: Chain, joints: tuple[Joint, ...]) -> tuple[list[int], list[tuple[int, int, float]]]:
    """Return the sign of the motion of every joint, and the couplings between joints (joint, leading joint, factor)."""
    weights = chain.weights[list(chain.moving)]
    if weights.shape != (len(joints), len(joints)) or not np.isin(np.diag(weights), (-1.0, 1.0)).all():
        raise InputError(
            "DH rows: a joint has several motions, or a factor; expected one motion per joint with factor 1 or -1"
        )
    others = [(i, j, float(w)) for (i, j), w in np.ndenumerate(weights) if i != j and w]
    return [int(w) for w in np.diag(weights)], others


def _placed(name: str, frame: Array) -> Iterator[str]:
    yield f"[{name}]"
    yield f"xyz_mm = {(1e3 * frame[:3, 3]).tolist()}"
    yield f"rpy_deg = {np.degrees(se3.roll_pitch_yaw(frame[:3, :3])).tolist()}"


def _limits(joint: Joint) -> Iterator[str]:
    unit, factor = ("deg", np.degrees(1.0)) if joint.kind == "revolute" else ("mm", 1e3)
    for side, limit in (("lower", joint.lower), ("upper", joint.upper)):
        if np.isfinite(limit):
            yield f"{side}_{unit} = {float(limit * factor)!r}"


def _about_z(angle: float) -> Array:
    return np.asarray(Rotation.from_euler("Z", angle).as_matrix(), dtype=float)


def _angle(about_z: Array) -> float:
    return float(np.arctan2(about_z[1, 0], about_z[0, 0]))


def _degrees(angle: float) -> str:
    """Write an angle in rad as degrees from -180 to 180."""
    return repr(float(np.degrees((angle + np.pi) % (2 * np.pi) - np.pi)))


def robodk_text(mechanism: Mechanism, chain: Chain, twists: Mapping[str, Array], note: str) -> str:
    """Write a chain with constant error twists, m and rad, by frame (slot), as CSV for RoboDK. note: first comment.

    Columns: rx, rz in deg, tx, tz in mm, and the joint whose value times its sign is added.
    Raises InputError if a joint is moved by several values, or the common normal of two axes is beyond FAR; DH rows in
    TOML express what RoboDK's cannot.
    """
    signs, others = _couplings(chain, mechanism.joints)
    names = [joint.name for joint in mechanism.joints]
    if others:
        i, j, _ = others[0]
        raise InputError(
            f"{names[i]} also moves with {names[j]}; expected joints that move independently, "
            "exports/dh_modified.toml has the coupling"
        )
    base, between, tool = along_z(chain, twists)
    steps = [across(frame, ROUNDING) for frame in between]
    for frame, step, pair in zip(between, steps, pairwise(names), strict=True):
        if abs(step.beta) > ROUNDING:
            raise InputError(
                f"axes of {' and '.join(pair)} are {np.degrees(tilt(frame)):.2g} deg from parallel, which puts their "
                f"common normal beyond {FAR:g} m; expected a nearer normal, exports/dh_modified.toml has a fifth "
                "column instead"
            )
    lines = commented(note)
    lines += ["# H = base * rotx(rx) transl(tx, 0, tz) rotz(rz) of every row * tool; sense times the joint's value is"]
    lines += ["# added to rz, of a prismatic one to tz", _frame("base", base), _frame("tool", tool)]
    lines += ["joint,kind,sense,rx [deg],tx [mm],tz [mm],rz [deg]"]
    rows = zip(mechanism.joints, signs, [Across(), *steps], [*steps, Across()], strict=True)
    for joint, sign, before, after in rows:
        angles = np.degrees([before.alpha, before.next_turn + after.turn])
        lengths = 1e3 * np.array([before.a, before.next_slide + after.slide])
        numbers = (repr(float(v)) for v in (angles[0], *lengths, angles[1]))
        lines.append(",".join([joint.name, joint.kind, str(sign), *numbers]))
    return "\n".join(lines) + "\n"


def _frame(name: str, frame: Array) -> str:
    """Write a frame as X, Y, Z, mm, R, P, W, deg: transl(x, y, z) rotz(w) roty(p) rotx(r)."""
    numbers = [*(1e3 * frame[:3, 3]), *np.degrees(se3.roll_pitch_yaw(frame[:3, :3]))]
    return f"# {name}, x y z r p w: {' '.join(repr(float(v)) for v in numbers)}"
