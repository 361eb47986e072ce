"""Compute corrected joint values that bring the real mechanism to given targets, with a limit on the correction."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gpmodel.application.kinematics import (
    REACHED,
    inverse,
    look_where_closed,
    matched_with_readings,
    reversed_approach,
    solve,
    tips,
    with_memory_columns,
    with_model_labels,
)
from gpmodel.application.model_file import SavedModel
from gpmodel.application.predict import point_deviation
from gpmodel.application.usable import check_finite, out_of_range, without_instrument
from gpmodel.arrays import ROUNDING, Array, IntArray, Mask
from gpmodel.calibration.unmeasured_joints import ROTATION_WEIGHT
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import closing, observe, prepare
from gpmodel.numerics import se3
from gpmodel.table.blocks import poses_of_tips
from gpmodel.table.cells import with_results
from gpmodel.table.convention import SENT
from gpmodel.table.dataset import Dataset
from gpmodel.table.read import dataset_from
from gpmodel.table.units import JOINT_UNITS, joint_column, split_header

OK, LARGE, SINGULAR = "ok", "large move", "near singular"
LIMIT, RANGE, LOST = "joint limit", "outside the measured range", "not reached"
SIDE = "side of play open"
Words = NDArray[np.object_]
GIVEN = (OK, SINGULAR, RANGE, SIDE)
"""Statuses of targets that have corrected joint values."""
MAX_MOVE = float(np.radians(2.0))
"""Default largest correction of a joint, rad; a metre of a prismatic joint counts as 1 / ROTATION_WEIGHT rad."""
FULL_TURN = float(np.radians(361.0))
"""Largest rotation vector of a target, rad: a full turn with rounding."""
DAMPED_ITERATIONS = 12
"""Number of Levenberg-Marquardt steps of the inverse kinematics with each damping."""
DAMPINGS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Damping weights of a radian of joint motion, relative to the weight of tool orientation, ROTATION_WEIGHT, m per rad.
From one damping weight to the next, the joint motion falls about threefold."""


@dataclass(frozen=True)
class TargetPoses:
    """Target poses of the tool in the root frame; inverse kinematics starts from the joint values of `dataset`.

    whole: True if targets have position and orientation, False for positions. unreachable: row numbers of targets that
    the nominal mechanism cannot reach.
    """

    dataset: Dataset
    frames: Array
    whole: bool
    unreachable: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


@dataclass(frozen=True)
class Compensation:
    """Corrected joint values and the result for each target.

    q: corrected joint values, rad and m, NaN if the status has no corrected values.
    status: text that states whether and how the target is reached.
    residual: remaining position error, m; turn: remaining orientation error, rad, NaN for position targets.
    correction: position error without compensation, m.
    sigma: predicted standard deviation, m, of the reached point from the target in the fitted registration.
    outside: inputs beyond the ranges of the model.
    For targets that the nominal mechanism cannot reach, the fields from residual on are NaN or empty.
    """

    q: Array
    status: tuple[str, ...]
    residual: Array
    turn: Array
    correction: Array
    sigma: Array
    outside: tuple[str, ...]


def targets_in(
    saved: SavedModel, text: pd.DataFrame, path: Path, rng: np.random.Generator, in_order: bool
) -> TargetPoses:
    """Read targets from a table: joint values, or else x, y and z in the root frame.

    text: cells of the table. path: file name for error messages. in_order: True if targets are approached in the order
    of the rows. Raises InputError for a table without targets for this mechanism.
    """
    mechanism = saved.mechanism
    names = {split_header(str(c))[0] for c in text.columns}
    numbered = {f"J{i}" for i in range(1, len(mechanism.joints) + 1)}
    if names & (numbered | {j.name for j in mechanism.joints}):
        dataset = dataset_from(text, path, mechanism, need_measurement=False)
        return joint_targets(saved, replace(dataset, in_order=in_order))
    if names & {"x", "y", "z"}:
        zeros = {f"{j.name} [{JOINT_UNITS[j.kind]}]": ["0"] * len(text) for j in mechanism.joints}
        dataset = dataset_from(text.assign(**zeros), path, mechanism)
        return cartesian_targets(saved, replace(dataset, in_order=in_order), rng)
    raise InputError(f"{path.name}: no targets; expected joint columns, or x, y and z in the root frame")


def compensated(saved: SavedModel, frame: pd.DataFrame, targets: TargetPoses, max_move: float) -> pd.DataFrame:
    """Add corrected joint values, correction, residual, sigma [mm] and status to a table of targets.

    Corrected values corrected_JOINT are those of the description. If the controller has other signs or zeros, columns
    to_controller_AXIS have them in the convention of the controller.
    Columns of an earlier compensation are replaced. Raises InputError if no target is reached.
    """
    found, names = compensate(saved, targets, max_move), _table_names(saved, targets.dataset)
    corrected = (
        joint_column(f"corrected_{name}", joint.kind, values)
        for name, joint, values in zip(names, saved.mechanism.joints, found.q.T, strict=True)
    )
    added = dict(corrected) | {
        "correction [mm]": 1e3 * found.correction,
        "residual [mm]": 1e3 * found.residual,
        "residual_turn [mrad]": 1e3 * found.turn,
        "sigma [mm]": 1e3 * found.sigma,
    }
    if (known := saved.convention) is not None and not known.unchanged:
        added |= known.columns(found.q, SENT)
    results: dict[str, Array | list[str]] = {**added, "outside": list(found.outside), "status": list(found.status)}
    table = with_results(frame, results, ("corrected_",))
    if set(found.status) == {LOST}:
        raise InputError(f"{targets.dataset.source}, {not_reached(saved.mechanism, table)}")
    return table


def not_reached(mechanism: Mechanism, corrected: pd.DataFrame) -> str:
    """Name the first unreachable target with its x, y, z, and the number of further unreachable targets."""
    rows = np.flatnonzero(corrected["status"] == LOST)
    if not len(rows):
        return ""
    point = corrected.iloc[rows[0]][[c for c in corrected.columns if split_header(str(c))[0] in ("x", "y", "z")]]
    target = ", ".join(f"{name} {cell}" for name, cell in point.items())
    more = f" ({len(rows)} targets in all)" if len(rows) > 1 else ""
    return f"row {rows[0] + 1}: {target or 'the target'} is out of reach of {mechanism.name}{more}"


def of_frame(saved: SavedModel) -> SavedModel:
    """Return the model with its tool point moved to the origin of the measured frame."""
    at_frame = dict.fromkeys(saved.placement.tool, np.eye(4))
    covariance = saved.covariance.with_certain([n for n in saved.covariance.placement if n.startswith("tool")])
    return replace(saved, placement=replace(saved.placement, tool=at_frame), covariance=covariance)


def _table_names(saved: SavedModel, dataset: Dataset) -> tuple[str, ...]:
    """Return the joint names of the targets; without joint columns, the joint names of the fitted table."""
    given = dataset.columns or dataset.joints
    return saved.columns if given == dataset.joints else given


def joint_targets(saved: SavedModel, dataset: Dataset) -> TargetPoses:
    """Return the tool poses of the nominal mechanism at given joint values, as targets.

    With at least six joints for each tip of a pose, a target has position and orientation, else a position alone.
    Raises InputError if the joint values do not belong to the machine of the model.
    """
    fitting = with_memory_columns(saved, matched_with_readings(saved, dataset))
    whole = len(saved.mechanism.joints) >= 6 * np.bincount(poses_of_tips(fitting)).max(initial=1)
    return TargetPoses(fitting, tips(saved, fitting, nominal=True)[1].tip, bool(whole))


def cartesian_targets(saved: SavedModel, dataset: Dataset, rng: np.random.Generator) -> TargetPoses:
    """Return targets in the root frame from dataset.position, m, and dataset.rotation, rad, with nominal joint values.

    Without rotations, or with fewer than six joints, a target is the position alone. Raises InputError for a row
    without a complete position, or with rotations in some rows only.
    """
    fitting = with_model_labels(saved, dataset)
    if not np.isfinite(dataset.position).all():
        row = int(dataset.row[~np.isfinite(dataset.position).all(axis=1)][0])
        raise InputError(f"{dataset.source}, row {row}: x, y or z is empty; expected a whole target in every row")
    turned = np.isfinite(dataset.rotation).all(axis=1)
    if turned.any() and not turned.all():
        row = int(dataset.row[~turned][0])
        raise InputError(f"{dataset.source}, row {row}: no rx, ry, rz; expected rotations in every row or in none")
    turns = np.nan_to_num(np.linalg.norm(dataset.rotation, axis=1))
    if turns.max() > FULL_TURN:
        row = int(dataset.row[turns.argmax()])
        raise InputError(
            f"{dataset.source}, row {row}: rx, ry, rz turn by {np.degrees(turns.max()):.4g} deg; expected at most 360, "
            "or another unit"
        )
    frames = se3.exp(np.hstack([np.zeros_like(dataset.position), np.nan_to_num(dataset.rotation)]))
    frames[:, :3, 3] = dataset.position
    whole = bool(turned.all()) and len(saved.mechanism.joints) >= 6
    q, reached = inverse(saved, fitting, frames, whole, rng)
    return TargetPoses(with_memory_columns(saved, replace(fitting, q=q)), frames, whole, np.flatnonzero(~reached))


def compensate(saved: SavedModel, targets: TargetPoses, max_move: float = MAX_MOVE) -> Compensation:
    """Return the joint values nearest to the initial values at which the real mechanism reaches each target.

    No joint moves by more than `max_move`, rad; a metre of a prismatic joint counts as 1 / ROTATION_WEIGHT rad. If the
    orientation needs a larger move near a singular pose, the position is reached exactly and the orientation as far as
    the limit allows. Raises InputError if an effect is infinite or undefined at a target.
    """
    saved = without_instrument(saved)
    targets = _closing_start(saved, targets)
    dataset = targets.dataset
    q, status = corrected(saved, targets, max_move)
    poses, observed = tips(saved, replace(dataset, q=q.copy()), nominal=False)
    beyond = out_of_range(saved, poses.states)
    beyond = tuple("" if k in targets.unreachable else names for k, names in enumerate(beyond))
    for k in np.flatnonzero((np.array(beyond, dtype=object) != "") & (status == OK)):
        status[k] = RANGE
    for k in np.flatnonzero(reversed_approach(saved, dataset.q, q) & (status == OK)):
        status[k] = SIDE
    without = tips(saved, dataset, nominal=False)[1].tip
    known = np.where(np.isin(np.arange(len(q)), targets.unreachable), np.nan, 1.0)
    turns = se3.rotation_vector(targets.frames[:, :3, :3] @ np.swapaxes(observed.tip[:, :3, :3], 1, 2))
    return Compensation(
        q=np.where(np.isin(status, GIVEN)[:, None], q, np.nan),
        status=tuple(str(s) for s in status),
        residual=known * np.linalg.norm(targets.frames[:, :3, 3] - observed.tip[:, :3, 3], axis=1),
        turn=known * np.linalg.norm(turns, axis=1) if targets.whole else np.full(len(q), np.nan),
        correction=known * np.linalg.norm(targets.frames[:, :3, 3] - without[:, :3, 3], axis=1),
        sigma=known * point_deviation(saved, poses, observe(saved.model, poses, saved.theta, saved.placement)),
        outside=beyond,
    )


def _closing_start(saved: SavedModel, targets: TargetPoses) -> TargetPoses:
    """Mark targets as unreachable if the real mechanism's kinematic loops cannot close at the nominal joint values.

    Unreachable targets get the joint values of another row as initial values.
    """
    dataset = targets.dataset
    closes = closing(saved.model, dataset, saved.theta)
    if len(closes) == len(dataset):
        return targets
    if not len(closes):
        point = ", ".join(f"{1e3 * v:.6g}" for v in targets.frames[0, :3, 3])
        name = saved.mechanism.name
        raise InputError(f"{dataset.source}, row {dataset.row[0]}: x, y, z of {point} mm is out of reach of {name}")
    lost = np.setdiff1d(np.arange(len(dataset)), closes)
    q = dataset.q.copy()
    q[lost] = q[closes[0]]
    return replace(targets, dataset=replace(dataset, q=q), unreachable=np.union1d(targets.unreachable, lost))


def corrected(
    saved: SavedModel, targets: TargetPoses, max_move: float = MAX_MOVE, *, part: bool = True
) -> tuple[Array, Words]:
    """Return joint values and status of each target as `compensate` does, without a check of measured ranges.

    saved: model without errors of the instrument. part: True to reach the orientation only partly near singular poses.
    Raises InputError if an effect is infinite or undefined at a target.
    """
    check_finite(saved, prepare(saved.mechanism, targets.dataset))
    dataset, start = targets.dataset, np.array(targets.dataset.q)
    q, left = solve(saved, replace(dataset, q=start.copy()), targets.frames, targets.whole, nominal=False)
    far = _moves(saved.mechanism, q - start) > max_move
    status = np.where(left < REACHED, np.where(far, LARGE, OK), LOST).astype(object)
    status[targets.unreachable] = LOST
    pose = poses_of_tips(dataset)
    alone = np.bincount(pose)[pose] == 1  # near a singular pose, several tips have no common damping
    again = np.setdiff1d(np.flatnonzero((status != OK) & alone), targets.unreachable)
    if part and targets.whole and len(again):
        within = TargetPoses(dataset.subset(again), targets.frames[again], True)
        damped, reached = _damped(saved, within, max_move)
        q[again[reached]] = damped[reached]
        status[again[reached]] = SINGULAR
    for k in np.flatnonzero(beyond_limits(saved.mechanism, q) & np.isin(status, (OK, SINGULAR))):
        status[k] = LIMIT
    return q, status


def _moves(mechanism: Mechanism, change: Array) -> Array:
    """Return the largest change of any joint at each pose, rad; a metre of a prismatic joint counts as 1 /
    ROTATION_WEIGHT rad."""
    scale = np.array([1.0 if joint.kind == "revolute" else 1.0 / ROTATION_WEIGHT for joint in mechanism.joints])
    return np.asarray(np.abs(change * scale).max(axis=1))


def beyond_limits(mechanism: Mechanism, q: Array) -> Mask:
    """Return whether any joint is beyond its limits, for each row of joint values, rad and m."""
    lower, upper = np.array([(j.lower, j.upper) for j in mechanism.joints]).T
    return np.asarray(((q < lower - ROUNDING) | (q > upper + ROUNDING)).any(axis=1))


def _damped(saved: SavedModel, targets: TargetPoses, max_move: float) -> tuple[Array, Mask]:
    """Return joint values that reach the target position, and a mask of the targets for which some damping keeps the
    move within `max_move`.

    The least damping that keeps the move within `max_move` is used for the orientation. Source: damped least squares in
    the null space, Chiaverini (1997).
    """
    count = len(targets.dataset)
    q, found = np.array(targets.dataset.q), np.zeros(count, dtype=bool)
    for damping in DAMPINGS:
        rows: IntArray = np.flatnonzero(~found)
        if not len(rows):
            break
        tried, left = _position_first(saved, targets, rows, damping)
        good = (left < REACHED) & (_moves(saved.mechanism, tried - targets.dataset.q[rows]) <= max_move)
        q[rows[good]], found[rows[good]] = tried[good], True
    return q, found


def _position_first(saved: SavedModel, targets: TargetPoses, rows: IntArray, damping: float) -> tuple[Array, Array]:
    """Iterate joint values q to the target position by steps dq, and return the remaining position error, m.

        dq = J_p⁺ m_p + N z,   min_z |w (J_o dq - m_o)|² + damping² |N (q + dq - q_start)|²,   N = 1 - J_p⁺ J_p

    J_p, J_o: Jacobians of position and orientation. m_p, m_o: their errors, m, rad. w: weight of an angle, m/rad.
    """
    start, frames = targets.dataset.subset(rows), targets.frames[rows]
    q = np.array(start.q)
    eye = np.eye(q.shape[1])
    for _ in range(DAMPED_ITERATIONS):
        miss, jacobian = look_where_closed(saved, replace(start, q=q.copy()), frames, nominal=False)
        miss[~np.isfinite(miss)] = 0.0
        first, second = jacobian[:, :3], ROTATION_WEIGHT * jacobian[:, 3:]
        inverse_first = np.linalg.pinv(first, rcond=1e-6)
        step = (inverse_first @ miss[:, :3, None])[:, :, 0]
        free = eye - inverse_first @ first
        turning = second @ free
        wanted = ROTATION_WEIGHT * miss[:, 3:] - (second @ step[:, :, None])[:, :, 0]
        pull = damping**2 * (free @ (q + step - start.q)[:, :, None])[:, :, 0]
        square = np.swapaxes(turning, 1, 2) @ turning + damping**2 * eye
        right = (np.swapaxes(turning, 1, 2) @ wanted[:, :, None])[:, :, 0] - pull
        q = q + step + (free @ np.linalg.solve(square, right[:, :, None]))[:, :, 0]
    miss = look_where_closed(saved, replace(start, q=q.copy()), frames, nominal=False)[0]
    return q, np.linalg.norm(miss[:, :3], axis=1)
