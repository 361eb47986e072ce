"""Ask the product about one machine measured by one instrument, as its owner would, and compare with the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.simulator import Array, draw_poses
from experiments.instruments.bound import bound, tool_points
from experiments.instruments.measuring import BOARD, PIXEL, Session, frame, session
from experiments.instruments.robots import CALLED, Robot, description, machine
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.weigh import weighed
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.se3 import frame_of, numbers_of
from gpmodel.table.dataset import unmeasured

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


def _named(found: gp.DiscoveryResult, robot: Robot) -> dict[str, Any]:
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


def _discovered(loaded: Mechanism, data: gp.Dataset) -> gp.DiscoveryResult:
    return gp.discover(loaded, data, holdout=HELD, search=gp.Search(runs=0, workers=1))


def converges(loaded: Mechanism, data: gp.Dataset, rng: np.random.Generator) -> bool:
    """Return whether a fit that starts 30 cm and 20 degrees off converges to the solution of the closed-form start."""
    poses = weighed(loaded, prepare(loaded, data))
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
