"""Joint values that make the real mechanism reach what the nominal one was meant to."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gpmodel.application.model_file import SavedModel, matched
from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.model.observed import Observed
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset
from gpmodel.table.read import dataset_from
from gpmodel.table.units import split_header
from gpmodel.table.write import joint_column

LENGTH = 0.3
REACHED = 1e-7
ITERATIONS = 120
DAMPING = 1e-12
LONGEST_STEP = 0.3
SEEDS = 24
RETRIES = 8
NEAR = 0.25
LIMIT_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Compensation:
    """Corrected joint values and what became of each target.

    q: (N, n), rad and m, NaN where the status is not "ok". status: (N,) text. residual: (N,) m left at the tool
    point. correction: (N,) m the real tool point would have missed by without it, NaN where unknown.
    """

    q: Array
    status: tuple[str, ...]
    residual: Array
    correction: Array


def compensate_frame(
    saved: SavedModel, frame: pd.DataFrame, text: pd.DataFrame, path: Path, rng: np.random.Generator
) -> pd.DataFrame:
    """`frame` of targets with corrected_JOINT, the correction and what is left [mm] and the status of each row.

    text: the same as cells of text, of `path`. Raises InputError where they are no targets of this mechanism.
    """
    mechanism = saved.mechanism
    names = {split_header(str(c))[0] for c in text.columns}
    numbered = {f"J{i}" for i in range(1, len(mechanism.joints) + 1)}
    if names & (numbered | {j.name for j in mechanism.joints}):
        found = compensate_joints(saved, dataset_from(text, path, mechanism, need_measurement=False))
    elif names & {"x", "y", "z"}:
        units = {"revolute": "rad", "prismatic": "m"}
        zeros = {f"{j.name} [{units[j.kind]}]": ["0"] * len(text) for j in mechanism.joints}
        found = compensate_targets(saved, dataset_from(text.assign(**zeros), path, mechanism), rng)
    else:
        raise InputError(f"{path.name}: no targets; expected joint columns, or x, y and z in the root frame")
    corrected = (
        joint_column(f"corrected_{joint.name}", joint.kind, values)
        for joint, values in zip(mechanism.joints, found.q.T, strict=True)
    )
    added = dict(corrected) | {"correction [mm]": 1e3 * found.correction, "residual [mm]": 1e3 * found.residual}
    return frame.assign(**added, status=list(found.status))


def compensate_joints(saved: SavedModel, dataset: Dataset) -> Compensation:
    """Corrected values for nominal joint values: the real tool reaches the pose the nominal mechanism would have.

    The whole pose of the tool with six joints or more, its position with fewer. Raises InputError as `matched`.
    """
    fitting = matched(saved, dataset)
    target = _tips(saved, fitting, nominal=True).tip
    without = _tips(saved, fitting, nominal=False).tip
    return _solve(saved, fitting, target, dataset.q, _whole_pose(saved.mechanism), without)


def compensate_targets(saved: SavedModel, dataset: Dataset, rng: np.random.Generator) -> Compensation:
    """Joint values for tool poses in the mechanism's root frame: dataset.position, m, and dataset.rotation, rad.

    Without rotations, or with fewer than six joints, the position alone is reached. Of the nominal solutions from
    several random starts within the limits, the one nearest the middle of the ranges is corrected.
    Raises InputError for a row without a whole position, or with rotations in some rows only.
    """
    fitting = matched(saved, dataset)
    if not np.isfinite(dataset.position).all():
        row = int(dataset.row[~np.isfinite(dataset.position).all(axis=1)][0])
        raise InputError(f"{dataset.source}, row {row}: x, y or z is empty; expected a whole target in every row")
    turned = np.isfinite(dataset.rotation).all(axis=1)
    if turned.any() and not turned.all():
        row = int(dataset.row[~turned][0])
        raise InputError(f"{dataset.source}, row {row}: no rx, ry, rz; expected rotations in every row or in none")
    twists = np.hstack([np.zeros_like(dataset.position), np.nan_to_num(dataset.rotation)])
    target = se3.exp(twists)
    target[:, :3, 3] = dataset.position
    whole = bool(turned.all()) and _whole_pose(saved.mechanism)
    start = _inverse(saved, fitting, target, whole, rng)
    nominal = replace(fitting, q=start)
    without = _tips(saved, nominal, nominal=False).tip
    return _solve(saved, nominal, target, start, whole, without)


def _whole_pose(mechanism: Mechanism) -> bool:
    return len(mechanism.joints) >= 6


def _tips(saved: SavedModel, dataset: Dataset, *, nominal: bool) -> Observed:
    """Tool poses in the root frame, and what moves them."""
    empty = ErrorModel(saved.mechanism, ())
    model, theta = (empty, np.zeros(0)) if nominal else saved.model.of_the_mechanism(saved.theta)
    root = Placement({name: np.eye(4) for name in saved.placement.registration}, saved.placement.tool, {})
    bare = replace(dataset, distances={})
    return observe(model, prepare(saved.mechanism, bare), theta, root)


def _jacobian(mechanism: Mechanism, observed: Observed) -> Array:
    """Change (N, 6, n) of tool position, m, and rotation, rad, per unit of each joint value."""
    columns = []
    for joint in mechanism.joints:
        parts = [w * observed.sensitivity(mechanism.slots.index(s))[:, :6, AXES.index(a)] for s, a, w in joint.drive]
        columns.append(np.sum(parts, axis=0))
    return np.stack(columns, axis=2)


def _miss(observed: Observed, target: Array) -> Array:
    """Target minus tool (N, 6): m, and rad as a rotation vector."""
    turn = target[:, :3, :3] @ np.swapaxes(observed.tip[:, :3, :3], 1, 2)
    return np.hstack([target[:, :3, 3] - observed.tip[:, :3, 3], se3.rotation_vector(turn)])


def _newton(saved: SavedModel, dataset: Dataset, target: Array, whole: bool, *, nominal: bool) -> tuple[Array, Array]:
    """Joint values (N, n) and what is left (N,), m, rotations weighed by LENGTH.

    Levenberg-Marquardt for every row by itself, on the columns of the joints' own drives: exact for the nominal
    mechanism, and off by the size of the errors for the real one. Source: Moré (1978).
    """
    weight = np.array([1.0] * 3 + [LENGTH if whole else 0.0] * 3)

    def look(q: Array, rows: IntArray) -> tuple[Array, Array]:
        observed = _tips(saved, replace(dataset.subset(rows), q=q.copy()), nominal=nominal)
        return _miss(observed, target[rows]) * weight, _jacobian(saved.mechanism, observed) * weight[:, None]

    q = np.array(dataset.q)
    active = np.arange(len(q))
    miss, jacobian = look(q, active)
    damping = np.full(len(q), DAMPING)
    for _ in range(ITERATIONS):
        active = np.flatnonzero((np.linalg.norm(miss, axis=1) > REACHED / 100) & (damping < 1e3))
        if len(active) == 0:
            break
        columns = jacobian[active]
        square = columns @ np.swapaxes(columns, 1, 2) + damping[active, None, None] * np.eye(6)
        step = (np.swapaxes(columns, 1, 2) @ np.linalg.solve(square, miss[active][:, :, None]))[:, :, 0]
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        tried, slopes = look(q[active] + step, active)
        better = np.linalg.norm(tried, axis=1) < np.linalg.norm(miss[active], axis=1)
        good = active[better]
        q[good], miss[good], jacobian[good] = (q[active] + step)[better], tried[better], slopes[better]
        damping[active] = np.where(better, np.maximum(damping[active] / 10, DAMPING), damping[active] * 5)
    return q, np.linalg.norm(miss, axis=1)


def _inverse(saved: SavedModel, dataset: Dataset, target: Array, whole: bool, rng: np.random.Generator) -> Array:
    mechanism = saved.mechanism
    count = len(dataset)
    each = np.repeat(np.arange(count), SEEDS)
    many = replace(dataset.subset(each), q=random_poses(mechanism, count * SEEDS, rng))
    q, left = _newton(saved, many, target[each], whole, nominal=True)
    turning = np.array([j.kind == "revolute" for j in mechanism.joints])
    q = np.where(turning, (q + np.pi) % (2 * np.pi) - np.pi, q)
    lower, upper = np.array([(j.lower, j.upper) for j in mechanism.joints]).T
    middle = np.where(np.isfinite(lower + upper), (lower + upper) / 2, 0.0)
    width = np.where(np.isfinite(upper - lower), upper - lower, 2 * np.pi)
    cost = np.linalg.norm((q - middle) / width, axis=1) + 10.0 * ((q < lower) | (q > upper)).any(axis=1)
    cost = cost + np.where(left < REACHED * 10, 0.0, 1e3 + left)
    chosen = cost.reshape(count, SEEDS).argmin(axis=1) + SEEDS * np.arange(count)
    return q[chosen]


def _solve(
    saved: SavedModel, dataset: Dataset, target: Array, start: Array, whole: bool, without: Array
) -> Compensation:
    q, left = _corrected(saved, replace(dataset, q=np.array(start)), target, whole)
    reached = _tips(saved, replace(dataset, q=q.copy()), nominal=False).tip
    status = tuple(_status(saved.mechanism, row, rest) for row, rest in zip(q, left, strict=True))
    ok: NDArray[np.bool_] = np.array([s == "ok" for s in status], dtype=bool)
    return Compensation(
        q=np.where(ok[:, None], q, np.nan),
        status=status,
        residual=np.linalg.norm(target[:, :3, 3] - reached[:, :3, 3], axis=1),
        correction=np.linalg.norm(target[:, :3, 3] - without[:, :3, 3], axis=1),
    )


def _corrected(saved: SavedModel, dataset: Dataset, target: Array, whole: bool) -> tuple[Array, Array]:
    """Solutions from the nominal values; where that stops short, near a singular pose, from values around them."""
    q, left = _newton(saved, dataset, target, whole, nominal=False)
    short = np.flatnonzero(left > REACHED)
    if len(short):
        each = np.repeat(short, RETRIES)
        around = dataset.q[each] + np.random.default_rng(0).normal(0.0, NEAR / 2, (len(each), q.shape[1]))
        others, rest = _newton(saved, replace(dataset.subset(each), q=around), target[each], whole, nominal=False)
        far = np.abs(others - dataset.q[each]).max(axis=1)
        cost = np.where((rest < REACHED) & (far < 2 * NEAR), far, np.inf).reshape(len(short), RETRIES)
        best = cost.argmin(axis=1)
        found = np.isfinite(cost.min(axis=1))
        chosen = (np.arange(len(short)) * RETRIES + best)[found]
        q[short[found]], left[short[found]] = others[chosen], rest[chosen]
    return q, left


def _status(mechanism: Mechanism, q: Array, left: float) -> str:
    if not left < REACHED:
        return f"not reached: out of reach or singular, {1e3 * left:.3g} mm left"
    for joint, value in zip(mechanism.joints, q, strict=True):
        if not joint.lower - LIMIT_TOLERANCE <= value <= joint.upper + LIMIT_TOLERANCE:
            return f"beyond the limit of {joint.name}"
    return "ok"
