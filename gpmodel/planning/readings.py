"""Simulated readings of a mechanism with known errors."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.errors import InputError
from gpmodel.formula.expression import ONE
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, measured_minus, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.planning.scenes import BAR, BOARD, NEARBY, Scene
from gpmodel.table.dataset import Dataset

CLOSE, STEPS, REDRAWN = 1e-9, 25, 12
"""Metres a touch may be off; steps from one start; starts."""


@dataclass(frozen=True)
class Real:
    """A mechanism with its errors, where its root and its tool are."""

    model: ErrorModel
    theta: Array
    placement: Placement


def read_in(
    scene: Scene, real: Real, empty: Dataset, noise: float, rng: np.random.Generator
) -> tuple[Dataset, Placement]:
    """Simulate the readings of a mechanism with known errors, and the placement with the observations' unknowns.

    empty: the poses with nothing measured. noise: standard deviation of one reading, m, px or rad.
    """
    mechanism = real.model.mechanism
    if scene.aims is not None:
        labels = {**empty.labels, **scene.labels}
        q = _reached(scene, real, empty, noise, rng)
        lengths = {"length": np.full(len(q), BAR)} if scene.instrument == "bar" else {}
        data = replace(empty, q=q, labels=labels, readings=lengths)
        return with_observations(data, mechanism), real.placement
    corners = BOARD[0] * BOARD[1] if scene.own else 1
    data = empty.subset(np.repeat(np.arange(len(empty)), corners))
    data = replace(data, row=np.arange(1, len(data) + 1), described=scene.described or {})
    columns = ("u", "v") if scene.own else ("inclination_x", "inclination_y")
    labels = {k: np.repeat(v, corners) for k, v in scene.labels.items()}
    if scene.own:
        labels = {"camera": np.full(len(data), "C"), "marker": np.tile(np.arange(corners).astype(str), len(empty))}
    data = replace(data, labels={**data.labels, **labels}, readings=dict.fromkeys(columns, np.zeros(len(data))))
    own = scene.own or _mounted(scene, rng)
    there = replace(real.placement, anchors={**real.placement.anchors, **own})
    data = with_observations(data, mechanism)
    read = -measured_minus(observe(real.model, prepare(mechanism, data), real.theta, there), data)[:, 6:]
    read = read + noise * rng.normal(size=read.shape)
    data = replace(data, readings=dict(zip(columns, read.T, strict=True)))
    return with_observations(data, mechanism), there


def _mounted(scene: Scene, rng: np.random.Generator) -> dict[str, Array]:
    link = scene.labels["link"][0]
    return {"vertical": np.array([0.0, 0.0, 1.0]), f"inclinometer {link}": rng.normal(0.0, 0.3, 3)}


def _reached(scene: Scene, real: Real, empty: Dataset, noise: float, rng: np.random.Generator) -> Array:
    """Joint values (N, n) at which the real tool point is where it should touch, but for the noise of a contact."""
    assert scene.aims is not None
    mechanism, q = real.model.mechanism, scene.q.copy()
    limits = np.array([(j.lower, j.upper) for j in mechanism.joints]).T
    drives = tuple(drive_effect(j.name, j, ONE) for j in mechanism.joints)
    slip = noise * rng.normal(size=(len(q), 3))
    points, short = np.zeros((len(q), 3)), np.arange(len(q))
    for step in range(1, STEPS * REDRAWN + 1):
        poses = prepare(mechanism, replace(empty.subset(short), q=q[short].copy()))
        observed = observe(real.model, poses, real.theta, real.placement)
        points[short] = observed.tips.root[:, :3, 3]
        miss = (scene.aims(points - slip) + slip - points)[short]
        off = np.linalg.norm(miss, axis=1) > CLOSE
        reach = np.swapaxes(observed.tips.turn, 1, 2) @ effect_columns(drives, real.model, poses, observed)[:, :3]
        short, miss, reach = short[off], miss[off], reach[off]
        if not len(short):
            return q
        if step % STEPS == 0:
            some = rng.integers(len(scene.spare), size=(len(short), NEARBY))
            arm = short % len(scene.points)
            far = np.linalg.norm(scene.points[arm[:, None], some] - (points[short] + miss)[:, None], axis=2)
            q[short] = scene.spare[some[np.arange(len(some)), np.argmin(far, axis=1)]]
            continue
        gram = reach @ np.swapaxes(reach, 1, 2) + 1e-9 * np.eye(3)
        move = np.einsum("nij,ni->nj", reach, np.linalg.solve(gram, miss[:, :, None])[:, :, 0])
        move *= np.minimum(1.0, 0.3 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q[short] = np.clip(q[short] + move, *limits)
    raise InputError("some poses do not reach what they should touch; try another seed or more poses")
