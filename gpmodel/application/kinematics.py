"""Forward and inverse kinematics of nominal and calibrated mechanisms, in the root frame."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.unmeasured_joints import ROTATION_WEIGHT
from gpmodel.checks.mixed_up import FEWEST_OF_A_PART, MOST_ROWS, comparable_rows, mixed_up, typical_rows
from gpmodel.checks.notes import POOR_LENGTH
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.branches import branched, random_poses
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.mechanism.source import choice_of
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, closing, observe, prepare, rows_named
from gpmodel.model.memory import columns_of, read_by
from gpmodel.model.observed import Observed
from gpmodel.model.states import States, states_of, tip_slots
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.blocks import SAME_JOINT, poses_of_tips
from gpmodel.table.dataset import Dataset, with_payload

REACHED = 1e-7
"""Largest distance from a target that counts as reached, m: a tenth of the displayed micrometre."""
ITERATIONS = 60
"""Largest number of Newton steps of inverse kinematics to a target. Near a solution every Newton step squares the
error, so that more steps do not help."""
DAMPING = 1e-12
"""Smallest damping of inverse kinematics, m²/rad²: so small that steps near a solution are Newton steps."""
LONGEST_STEP = 0.3
"""Largest change of a joint in one step, rad or m. For larger changes the linearised kinematics is inaccurate."""
POOL = 4096
"""Number of random initial joint values for Cartesian targets: four for each combination of six joints."""
NEAREST = 6
"""Number of nearest initial joint values that are tried first for a target: the number of joints of most arms."""
SEEDS = 24
"""Number of random initial joint values tried before a target is called unreachable."""
UNSOLVED = 1e3
"""Cost of missing a target, larger than every distance of joint values from the middle of their ranges."""


def tips(saved: SavedModel, dataset: Dataset, *, nominal: bool) -> tuple[Poses, Observed]:
    """Return the poses and their tool frames in the root frame, by the nominal or the calibrated mechanism."""
    root = Placement({name: np.eye(4) for name in saved.placement.registration}, saved.placement.tool, {})
    bare = replace(dataset, distances={}, observations=())
    if nominal:
        states = States({"row": bare.row.astype(float)}, {"row": "1"})
        with rows_named(bare):
            poses = Poses(bare, saved.mechanism.transforms(bare.q), states, tip_slots(saved.mechanism, bare))
        return poses, observe(ErrorModel(saved.mechanism, ()), poses, np.zeros(0), root)
    poses = prepare(saved.mechanism, bare)
    return poses, observe(saved.model, poses, saved.theta, root)


def error_and_jacobian(saved: SavedModel, dataset: Dataset, target: Array, *, nominal: bool) -> tuple[Array, Array]:
    """Return the error of each pose to its target in the root frame, m and rad, and the Jacobian of the error.

    The Jacobian is that of the nominal mechanism. For the calibrated mechanism, the relative error of the Jacobian is
    of the order of the geometric errors.
    """
    observed = tips(saved, dataset, nominal=nominal)[1]
    turn = target[:, :3, :3] @ np.swapaxes(observed.tip[:, :3, :3], 1, 2)
    miss = np.hstack([target[:, :3, 3] - observed.tip[:, :3, 3], se3.rotation_vector(turn)])
    return miss, _jacobian(saved.mechanism, observed)


def _jacobian(mechanism: Mechanism, observed: Observed) -> Array:
    columns = []
    for joint in mechanism.joints:
        parts = [w * observed.sensitivity(mechanism.slots.index(s))[:, :6, AXES.index(a)] for s, a, w in joint.drive]
        columns.append(np.sum(parts, axis=0))
    return np.stack(columns, axis=2)


def solve(
    saved: SavedModel, dataset: Dataset, target: Array, whole: bool, *, nominal: bool, most: int = ITERATIONS
) -> tuple[Array, Array]:
    """Return joint values near the values in `dataset` that reach the targets, and the remaining error, m.

    The solver is Levenberg-Marquardt for each pose separately. Source: Moré (1978). Rows of different tips (of several
    arms) with equal initial joint values are one pose, which reaches all their targets. whole: True to reach position
    and (weighted) orientation; False for position alone. The error is infinite if kinematic loops cannot close.
    most: largest number of Newton steps.
    """
    weight = np.array([1.0] * 3 + [ROTATION_WEIGHT if whole else 0.0] * 3)
    pose = poses_of_tips(dataset)
    order = np.argsort(pose, kind="stable")
    first, count = np.unique(pose[order], return_index=True, return_counts=True)[1:]

    def look(q: Array, poses: IntArray) -> tuple[Array, Array]:
        miss = np.zeros((len(poses), count.max(initial=1), 6))
        slopes = np.zeros((*miss.shape, q.shape[1]))
        for k in range(miss.shape[1]):
            here = np.flatnonzero(count[poses] > k)
            rows = order[first[poses[here]] + k]
            at = replace(dataset.subset(rows), q=q[here].copy())
            errors, jacobian = look_where_closed(saved, at, target[rows], nominal)
            errors[np.isfinite(errors).all(axis=1)] *= weight
            miss[here, k], slopes[here, k] = errors, jacobian * weight[:, None]
        return miss.reshape(len(poses), -1), slopes.reshape(len(poses), -1, q.shape[1])

    q, left = _levenberg(look, np.array(dataset.q[order[first]]), most)
    return q[pose], left[pose]


def look_where_closed(saved: SavedModel, dataset: Dataset, target: Array, nominal: bool) -> tuple[Array, Array]:
    """Return the errors to the targets and their Jacobian; infinite and zero for poses at which a closed loop of the
    mechanism cannot close."""
    model = ErrorModel(saved.mechanism, ()) if nominal else saved.model
    able = closing(model, dataset, saved.theta[: len(model.effects)])
    if len(able) == len(dataset):
        return error_and_jacobian(saved, dataset, target, nominal=nominal)
    miss, jacobian = np.full((len(dataset), 6), np.inf), np.zeros((len(dataset), 6, dataset.q.shape[1]))
    if len(able):
        miss[able], jacobian[able] = error_and_jacobian(saved, dataset.subset(able), target[able], nominal=nominal)
    return miss, jacobian


def _levenberg(look: Callable[[Array, IntArray], tuple[Array, Array]], q: Array, most: int) -> tuple[Array, Array]:
    miss, jacobian = look(q, np.arange(len(q)))
    damping = np.full(len(q), DAMPING)
    for _ in range(most):
        left = np.linalg.norm(miss, axis=1)
        active = np.flatnonzero((left > REACHED / 100) & (damping < 1e3) & np.isfinite(left))
        if len(active) == 0:
            break
        columns = jacobian[active]
        square = columns @ np.swapaxes(columns, 1, 2) + damping[active, None, None] * np.eye(miss.shape[1])
        step = (np.swapaxes(columns, 1, 2) @ np.linalg.solve(square, miss[active][:, :, None]))[:, :, 0]
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        tried, slopes = look(q[active] + step, active)
        better = np.linalg.norm(tried, axis=1) < left[active]
        good = active[better]
        q[good], miss[good], jacobian[good] = (q[active] + step)[better], tried[better], slopes[better]
        damping[active] = np.where(better, np.maximum(damping[active] / 10, DAMPING), damping[active] * 5)
    return q, np.linalg.norm(miss, axis=1)


def inverse(
    saved: SavedModel, dataset: Dataset, target: Array, whole: bool, rng: np.random.Generator
) -> tuple[Array, Mask]:
    """Return nominal joint values for targets in the root frame, and a mask of the reached targets.

    Of several inverse solutions, that nearest the middle of the joint ranges is returned. Initial values are the poses
    of a random pool with the nearest tools, then random values. An unreached target keeps its nearest initial values.
    """
    pool = random_poses(saved.mechanism, POOL, rng)
    many = replace(dataset.subset(np.zeros(POOL, dtype=np.int64)), q=pool)
    near = cKDTree(_place(tips(saved, many, nominal=True)[1].tip, whole))
    nearest = pool[near.query(_place(target, whole), k=NEAREST)[1]]
    q, cost = _best(saved, dataset, target, whole, nearest)
    lost = np.flatnonzero(cost >= UNSOLVED)
    if len(lost):
        starts = random_poses(saved.mechanism, len(lost) * SEEDS, rng).reshape(len(lost), SEEDS, -1)
        again, other = _best(saved, dataset.subset(lost), target[lost], whole, starts)
        reached = other < UNSOLVED
        q[lost] = np.where(reached[:, None], again, nearest[lost, 0])
        cost[lost] = other
    return q, cost < UNSOLVED


def _place(frames: Array, whole: bool) -> Array:
    """Return points whose distance measures the difference of tool poses: positions, m, and weighted axes, m."""
    axes = ROTATION_WEIGHT * frames[:, :3, :3].reshape(len(frames), 9)
    return np.hstack([frames[:, :3, 3], axes]) if whole else frames[:, :3, 3]


def _best(saved: SavedModel, dataset: Dataset, target: Array, whole: bool, starts: Array) -> tuple[Array, Array]:
    """Return the best solution from several initial values, and its cost, which is at least UNSOLVED if no initial
    value led to the target."""
    mechanism = saved.mechanism
    count, tries, joints = starts.shape
    each = np.repeat(np.arange(count), tries)
    many = replace(dataset.subset(each), q=starts.reshape(-1, joints))
    q, left = solve(saved, many, target[each], whole, nominal=True)
    turning = np.array([j.kind == "revolute" for j in mechanism.joints])
    q = np.where(turning, (q + np.pi) % (2 * np.pi) - np.pi, q)
    lower, upper = np.array([(j.lower, j.upper) for j in mechanism.joints]).T
    middle = np.where(np.isfinite(lower + upper), (lower + upper) / 2, 0.0)
    width = np.where(np.isfinite(upper - lower), upper - lower, 2 * np.pi)
    cost = np.linalg.norm((q - middle) / width, axis=1) + 10.0 * ((q < lower) | (q > upper)).any(axis=1)
    cost = (cost + np.where(left < REACHED * 10, 0.0, UNSOLVED + left)).reshape(count, tries)
    chosen = cost.argmin(axis=1)
    return q[chosen + tries * np.arange(count)], cost[np.arange(count), chosen]


LOADS = ("payload", "torque_", "moment_", "force_")
"""First letters of the names of input columns that depend on the payload."""


def with_model_labels(saved: SavedModel, dataset: Dataset) -> Dataset:
    """Match a dataset to a model: fill in the model's payload, and labels of its set-ups and tools.

    Raises InputError for an unknown set-up or tool, or an input that is missing or in another unit.
    """
    for name, unit in saved.input_units.items():
        if name not in dataset.extras:
            raise InputError(f"{dataset.source}: column '{name} [{unit}]' is missing; the model needs this column")
        if dataset.extra_units[name] != unit:
            given = dataset.extra_units[name]
            raise InputError(
                f"{dataset.source}: column '{name}' is in [{given}]; expected [{unit}], as in the fit of the model"
            )
    if not dataset.payload_given:
        stated, fitted = choice_of(saved.mechanism).payload, saved.measured
        dataset = with_payload(dataset, stated)
        inputs = columns_of(name for effect in saved.model.effects for name in effect.inputs)
        carried = stated is None and fitted is not None and fitted.dataset.payload_given
        if "payload" in inputs or (carried and any(name.startswith(LOADS) for name in inputs)):
            raise InputError(f"{dataset.source}: column 'payload [kg]' is missing; the model needs this column")
    labels = dict(dataset.labels)
    for column, known in (("setup", saved.placement.registration), ("tool", saved.placement.tool)):
        labelled = set(dataset.label(column).tolist())
        if labelled == {""} and len(known) == 1:
            labels[column] = np.full(len(dataset), next(iter(known)))
        elif surplus := sorted(labelled - set(known)):
            expected = choices(surplus[0], (f"'{k}'" for k in known))
            raise InputError(f"{dataset.source}: {column} '{surplus[0]}' is unknown to the model; expected {expected}")
    return replace(dataset, labels=labels)


def matched_with_readings(saved: SavedModel, dataset: Dataset) -> Dataset:
    """Match a dataset to a model as `with_model_labels` does, after a check that both are of one machine.

    Raises InputError for unknown labels or inputs, and if the residual of most positions exceeds 1 cm (POOR_LENGTH)
    after a fit of registration and tool point.
    """
    if mixed := mixed_up(saved.mechanism, dataset):
        raise InputError(f"{dataset.source}: {mixed}; expected a table of {saved.mechanism.name}")
    fitting, rows = with_model_labels(saved, dataset), comparable_rows(dataset)
    rows = rows[:: max(1, len(rows) // MOST_ROWS)]
    known = all(joint.measured for joint in saved.mechanism.joints) and not branched(saved.mechanism)
    if known and len(rows) >= FEWEST_OF_A_PART:
        with np.errstate(all="ignore"):  # undefined effects are reported by the caller
            frames = tips(saved, fitting.subset(rows), nominal=False)[1].tip
        if not np.isfinite(frames).all():
            return fitting
        most, errors = typical_rows(frames, dataset.position[rows])
        if (left := root_mean_square(errors[most])) > POOR_LENGTH:
            raise InputError(
                f"{dataset.source}: the positions do not fit the model of {saved.mechanism.name}, which leaves "
                f"{1e3 * left:.3g} mm after a new fit of registration and tool point; expected less than "
                f"{1e3 * POOR_LENGTH:g} mm"
            )
    return fitting


def with_memory_columns(saved: SavedModel, dataset: Dataset, more: Iterable[Effect] = ()) -> Dataset:
    """Return the dataset with inputs that depend on earlier rows, such as directions of approach, as columns.

    more: further effects with inputs that depend on earlier rows. As columns, inputs that depend on earlier rows do not
    change with small corrections of joint values.
    Raises InputError if the rows are not known to be in order.
    """
    read = {name for effect in (*saved.model.effects, *more) for name in effect.inputs if read_by(name)}
    inherited = sorted(read - set(dataset.extras))
    if not inherited:
        return dataset
    states = states_of(saved.mechanism, dataset)
    return replace(
        dataset,
        extras={**dataset.extras, **{name: states[name] for name in inherited}},
        extra_units={**dataset.extra_units, **dict.fromkeys(inherited, "1")},
    )


def reversed_approach(saved: SavedModel, nominal: Array, corrected: Array) -> Mask:
    """Return a mask of the targets that a joint approaches from another side than without correction.

    The mask considers only joints whose direction of approach is an input of the model.
    """
    read = {source for effect in saved.model.effects for name in effect.inputs for source in read_by(name)}
    out = np.zeros(len(nominal), dtype=bool)
    for j, joint in enumerate(saved.mechanism.joints):
        if joint.name in read:
            before, after = (np.diff(values[:, j]) for values in (nominal, corrected))
            sides = [np.where(np.abs(move) > SAME_JOINT, np.sign(move), 0.0) for move in (before, after)]
            out[1:] |= sides[0] != sides[1]
    return out
