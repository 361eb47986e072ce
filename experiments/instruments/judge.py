"""Run gpmodel on one machine measured by one instrument, and compare with the true values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.simulator import Array, draw_poses
from experiments.instruments.measuring import BOARD, PIXEL, Session, frame, session
from experiments.instruments.robots import CALLED, GEOMETRY, Robot, description, ends, machine
from gpmodel.api.discover import DiscoveryResult
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.se3 import frame_of, numbers_of
from gpmodel.table.dataset import unmeasured

STEP, UNSEEN = 1e-6, 1e-6
"""Step of a difference, m or rad, and singular value of unit columns below which nothing is observable."""


def tool_points(robots: tuple[Robot, ...], made: Session, q: Array, arm: Array) -> Array:
    """Where the tool, or the camera or board it holds, really is on the floor (N, 3) at joint values q (N, all)."""
    x = _truth(robots, made)
    last, tools = _frames(robots, q, arm)(x)
    return ends(last, _held(made, x, tools))


def bound(robots: tuple[Robot, ...], made: Session, q: Array, arm: Array) -> float:
    """RMS deviation, m, of the tool at joint values q (N, all) of arms (N,), at least.

    C = (JᵀJ + P)⁻¹ of readings in standard deviations; the tool's deviation is that of G C Gᵀ less a motion of the
    whole. P is what the errors of the description are drawn with, so that lengths which touches leave open have a bound
    too; where the readings say everything it lowers the bound by a fiftieth. The form of an effect is told, size and
    phase are not. Source: Van Trees (1968), Detection, Estimation, and Modulation Theory I, ch. 2.
    """
    start = _truth(robots, made)
    there, fresh = _frames(robots, made.q, made.arm), _frames(robots, q, arm)
    own = len(start) - len(made.own)

    def readings(x: Array) -> Array:
        last, tools = there(x)
        return np.asarray(made.read(last, tools, x[own:]).ravel())

    def points(x: Array) -> Array:
        last, tools = fresh(x)
        return np.asarray(ends(last, _held(made, x, tools)).ravel())

    moved = _slopes(points, start)
    columns = np.vstack([_slopes(readings, start), np.diag(_described(robots, made))])
    size = np.linalg.norm(columns, axis=0)
    size[size < UNSEEN * size.max()] = np.inf
    _, s, v = np.linalg.svd(columns / size, full_matrices=False)
    seen = s > UNSEEN * s[0]
    spread = _still(moved, points(start).reshape(-1, 3)) @ ((v[seen].T / s[seen]) / size[:, None])
    return float(np.sqrt(np.sum(spread**2) / len(q)))


def _truth(robots: tuple[Robot, ...], made: Session) -> Array:
    """Base, errors, tool and effect of every robot, then the instrument's own."""
    each = []
    for r in robots:
        each += [r.base, r.errors.ravel(), r.tool, np.zeros(_constants(r, made))]
    return np.concatenate([*each, made.own])


def _described(robots: tuple[Robot, ...], made: Session) -> Array:
    """One over the standard deviation that each unknown is drawn with; zero of what nobody describes."""
    drawn = [
        np.concatenate([np.full(6 + r.errors.size, 1.0 / GEOMETRY), np.zeros(3 + _constants(r, made))]) for r in robots
    ]
    return np.concatenate([*drawn, np.zeros(len(made.own))])


def _constants(robot: Robot, made: Session) -> int:
    """Unknowns of its effect."""
    return len(robot.columns(made.q[:1, : len(robot.arm.rows)]))


def _frames(robots: tuple[Robot, ...], q: Array, arm: Array) -> Callable[[Array], tuple[Array, Array]]:
    """Unknowns to the last frame (N, 4, 4) and the tool (N, 3) of the arm in use. The effect is linear in its shares
    about what it truly is."""
    parts, first = [], 0
    for k, r in enumerate(robots):
        n, rows = len(r.arm.rows), np.flatnonzero(arm == k)
        mine = q[rows][:, first : first + n]
        first += n
        parts.append((r, rows, mine, r.true(mine), r.columns(mine)))

    def placed(x: Array) -> tuple[Array, Array]:
        last, tools, i = np.empty((len(q), 4, 4)), np.empty((len(q), 3)), 0
        for r, rows, mine, true, columns in parts:
            base, errors, tool, shares, rest = np.split(x[i:], np.cumsum([6, r.errors.size, 3, len(columns)]))
            i = len(x) - len(rest)
            amounts = np.concatenate([np.full(len(true), r.amount), shares])
            last[rows] = r.moved(mine, errors.reshape(-1, 6), base, true + columns, amounts)
            tools[rows] = tool
        return last, tools

    return placed


def _held(made: Session, x: Array, tools: Array) -> Array:
    """Return the tracked point at the tool: its point, or the origin of the camera or board that it holds."""
    return np.tile(frame(x[-6:])[:3, 3], (len(tools), 1)) if "camera" in made.kind else tools


def _slopes(of: Callable[[Array], Array], at: Array) -> Array:
    step = STEP * np.eye(len(at))
    return np.column_stack([(of(at + d) - of(at - d)) / (2 * STEP) for d in step])


def _still(moved: Array, points: Array) -> Array:
    """Columns (3 N, P) without the motion of all points (N, 3) together."""
    p = points - points.mean(axis=0)
    turns = np.concatenate([np.cross(e, p).reshape(-1, 1) for e in np.eye(3)], axis=1)
    basis = np.linalg.qr(np.hstack([np.tile(np.eye(3), (len(p), 1)), turns]))[0]
    return np.asarray(moved - basis @ (basis.T @ moved))


POSES = {
    "tracker": 60, "camera": 60, "hand camera": 60, "planes and spheres": 150, "bars": 200, "two arms": 240,
}  # fmt: skip
"""A bar takes two, as a point of two arms takes four."""
FRESH, WRONG, SLIP, HELD = 200, 0.05, np.radians(0.3), 0.3
"""Poses to judge at; share of corners that are wrong; rad that three joints of a slipped probe are off; share
held out."""
SHIFT, TURN = 0.3, np.radians(20.0)
"""Displacement and rotation of a wrong start, m and rad."""
CONVERGED = 1e-6
"""m and rad between where fits from two starts place a camera."""


def judge(kind: str, seed: int, guilty: bool, poses: int | None = None) -> dict[str, Any]:
    """One machine from nothing to its row of results."""
    arms = 2 if kind == "two arms" else 1
    robots, rng = machine(seed, guilty, arms), np.random.default_rng([seed, arms, 9])
    made = session(kind, robots, poses or POSES[kind], rng)
    fresh = np.hstack([draw_poses(r.arm, FRESH, rng) for r in robots])
    arm = np.arange(FRESH) % arms
    row: dict[str, Any] = {"kind": kind, "seed": seed, "guilty": guilty, "poses": len(made.q)}
    with TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(description(robots))
        loaded = gp.load_mechanism(str(file), frame="link_6,right_6" if arms > 1 else "link_6")
        text, wrong = table(made, loaded), _spoiled(made, rng) if guilty else None
        data = gp.read_table(text, loaded, **made.described)
        found = _discovered(loaded, data)
        off = tool_error(found.fit[0], made, robots, fresh, arm)
        least = bound(robots, made, fresh, arm)
        row |= {"um": 1e6 * off, "bound_um": 1e6 * least, "ratio": off / least}
        row |= {"truth": f"{robots[0].kind} J{robots[0].joint}" if guilty else "", **_named(found, robots[0])}
        if wrong is not None:
            spoiled, rows = wrong
            seen = _left_out(loaded, gp.read_table(table(spoiled, loaded), loaded, **made.described), kind)
            row |= {"wrong": len(rows), "wrong_found": len(seen & rows), "right_taken": len(seen - rows)}
        if guilty and "camera" in kind:
            row["converges"] = converges(loaded, data, rng)
    return row


def table(made: Session, loaded: Mechanism) -> pd.DataFrame:
    """Return the table of its owner: a row a pose, or a row a corner."""
    out = pd.DataFrame({f"{j.name} [deg]": np.degrees(v) for j, v in zip(loaded.joints, made.q.T, strict=True)})
    if "camera" not in made.kind:
        return out.assign(**made.columns).map(str)
    corners = len(BOARD)
    out = out.loc[out.index.repeat(corners)].reset_index(drop=True)
    pixels = PIXEL * made.noisy.reshape(-1, 2)
    marker = np.tile(np.arange(corners), len(made.q))
    return out.assign(**{"camera": "C", "marker": marker, "u [px]": pixels[:, 0], "v [px]": pixels[:, 1]}).map(str)


def tool_error(fit: Calibration, made: Session, robots: tuple[Robot, ...], q: Array, arm: Array) -> float:
    """RMS, m, of the tool predicted at joint values q, from where it really is, in the frame that fits best."""
    mechanism, placement = fit.model.mechanism, fit.placement
    blank = unmeasured([j.name for j in mechanism.joints], q)
    if len(robots) > 1:
        tips = np.array(["link_6", "right_6"])[arm]
        blank = replace(blank, labels={"tip": tips, "tool": tips})
    if "camera" in made.kind:
        held = "board B" if made.kind == "camera" else "camera C"
        placement = replace(placement, tool={"": frame_of(placement.anchors[held])})
    said = observe(fit.model, prepare(mechanism, blank), fit.theta, placement).tips.root[:, :3, 3]
    true = tool_points(robots, made, q, arm)
    said, true = said - said.mean(axis=0), true - true.mean(axis=0)
    left, _, right = np.linalg.svd(said.T @ true)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return float(np.sqrt(np.mean(np.sum((said @ turn - true) ** 2, axis=1))))


def _named(found: DiscoveryResult, robot: Robot) -> dict[str, Any]:
    """named: the undeclared effect by its own name at its own joint. false: findings at another joint, or of an
    innocent."""
    own = [f.slot.split(".")[0] == f"J{robot.joint}" for f in found.findings]
    called = [mine and f.name.startswith(CALLED[robot.kind]) for f, mine in zip(found.findings, own, strict=True)]
    names = [f"{f.name} @ {f.slot}" for f in found.findings]
    return {"found": names, "named": any(called), "false": sum(not mine for mine in own)}


def _left_out(loaded: Mechanism, data: gp.Dataset, kind: str) -> set[int]:
    """The rows that the product does not believe, counted from zero: wrong corners stand far out beside the geometry
    alone; a touch that slipped does beside what is found."""
    if "camera" in kind:
        return set(gp.calibrate(loaded, data).fit[0].outliers.tolist())
    return set(_discovered(loaded, data).fit[0].outliers.tolist())


def _discovered(loaded: Mechanism, data: gp.Dataset) -> DiscoveryResult:
    return gp.discover(loaded, data, holdout=HELD, search=gp.Search(runs=0, workers=1))


def converges(loaded: Mechanism, data: gp.Dataset, rng: np.random.Generator) -> bool:
    """Return whether a fit that starts 30 cm and 20 degrees off converges to the solution of the closed-form start."""
    poses = prepare(loaded, data)
    model = ErrorModel(loaded, geometric_effects(loaded))
    right = calibrate(model, poses, condition_limit=100.0)
    away, axis = rng.normal(size=(2, 3))
    step = np.concatenate([SHIFT * away / np.linalg.norm(away), TURN * axis / np.linalg.norm(axis)])
    at = numbers_of(frame_of(right.placement.anchors["camera C"]) @ frame(step))
    placement = replace(right.placement, anchors={**right.placement.anchors, "camera C": at})
    start = replace(right, placement=placement, theta=np.zeros_like(right.theta))
    again = calibrate(model, poses, condition_limit=100.0, start=start)
    return again.status == "converged" and _sigma(again, poses) < (1.0 + CONVERGED) * _sigma(right, poses)


def _sigma(fit: Calibration, poses: Poses) -> float:
    return float(np.sqrt(np.mean(np.delete(fit.error, fit.outliers) ** 2)))


def _spoiled(made: Session, rng: np.random.Generator) -> tuple[Session, set[int]] | None:
    """Return the session with wrong corners or one slipped touch, and the affected rows, counted from zero."""
    if "camera" in made.kind:
        noisy = made.noisy.reshape(-1, 2).copy()
        rows = rng.choice(len(noisy), int(WRONG * len(noisy)), replace=False)
        noisy[rows] += rng.choice([-1.0, 1.0], (len(rows), 2)) * rng.uniform(4.0, 40.0, (len(rows), 2)) / PIXEL
        return replace(made, noisy=noisy.reshape(made.noisy.shape)), {*rows.tolist()}
    if made.kind != "planes and spheres":
        return None
    row, q = int(rng.integers(len(made.q))), made.q.copy()
    q[row, :3] += SLIP * rng.choice([-1.0, 1.0], 3)
    return replace(made, q=q), {row}
