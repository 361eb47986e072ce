"""The weighted linear problem at one point: what every parameter does to every observation."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.joint_readings import JointReadings, joint_readings
from gpmodel.calibration.unmeasured_joints import (
    Complement,
    complement,
    free_joints,
    joint_columns,
    observable,
    solve_joints,
    without_eliminated,
)
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, places
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe
from gpmodel.model.observed import Observed
from gpmodel.numerics import se3


@dataclass(frozen=True)
class Linearised:
    """One weighted linear problem: columns (M, K) · step ≈ residual (M,), with what each row belongs to.

    The first `placement` columns are registration, tool and anchors; the others are the model's effects.
    Metres throughout: rotations are weighted by `rotation_weight`. observed: what was predicted. poses: those given,
    with free joints solved. sizes: (K,) norms of the weighted columns before each pose's free joints were eliminated.
    weights: (N, m), positive where an observation is a row; `left` is what free joints leave, None without any.
    """

    columns: Array
    residual: Array
    pose_of_row: IntArray
    placement: int
    placement_names: tuple[str, ...]
    observed: Observed
    poses: Poses
    sizes: Array
    weights: Array
    left: "Left | None" = None

    def free(self, kept: Mask) -> Mask:
        """The columns (K,) of the placement and of the effects that are kept (E,)."""
        return np.concatenate([np.ones(self.placement, dtype=bool), kept])

    def effect_rows(self, effects: Sequence[Effect], model: ErrorModel) -> Array:
        """Columns (M, E) of any effects, weighted like the residual."""
        if self.left is not None:
            return self.weigh(effect_columns(tuple(effects), model, self.poses, self.observed))
        out = np.zeros((len(effects), len(self.residual)))
        return add_effect_rows(out, effects, model, self.poses, self.observed, self.weights).T

    def weigh(self, values: Array) -> Array:
        """Observations (N, m, ...) as rows (M, ...), weighted like the residual; what free joints absorb is zero."""
        shape = (*self.weights.shape, *([1] * (values.ndim - 2)))
        if self.left is not None:
            weighted = values * self.left.weights.reshape(shape)
            return without_eliminated(self.left.complement.rows(weighted), np.linalg.norm(weighted, axis=(0, 1)))
        return (values * self.weights.reshape(shape))[self.weights > 0]


@dataclass(frozen=True)
class Left:
    """What free joints leave of the observations, the weights (N, m) these had before, and what the table's own values
    of the joints tell."""

    complement: Complement
    weights: Array
    readings: JointReadings


def effect_columns(effects: tuple[Effect, ...], model: ErrorModel, poses: Poses, observed: Observed) -> Array:
    """Columns (N, m, E): sensitivity of the observations to each effect's unknown."""
    out = np.zeros((len(effects), len(poses), observed.components))
    for k, slot, axis, shape in _shaped(effects, model, poses, observed):
        out[k] += observed.sensitivity(slot)[:, :, axis] * shape[:, None]
    return np.moveaxis(out, 0, 2)


def add_effect_rows(
    out: Array, effects: Sequence[Effect], model: ErrorModel, poses: Poses, observed: Observed, weights: Array
) -> Array:
    """Adds to rows (E, M) the columns of the effects where weights (N, m) are positive, times these; `out` again.

    The same numbers as those of `effect_columns`, effect by effect in memory: what a slot does is brought into rows
    once.
    """
    rows = weights > 0
    pose, weight = np.nonzero(rows)[0], weights[rows][:, None]
    reach: dict[int, Array] = {}
    for k, slot, axis, shape in _shaped(effects, model, poses, observed):
        if slot not in reach:
            reach[slot] = np.ascontiguousarray((observed.sensitivity(slot)[rows] * weight).T)
        out[k] += reach[slot][axis] * shape[pose]
    return out


def _shaped(
    effects: Sequence[Effect], model: ErrorModel, poses: Poses, observed: Observed
) -> Iterator[tuple[int, int, int, Array]]:
    """Every term of some effects: the effect's number, indices of slot and axis, weight times basis (N,)."""
    known = places(model.mechanism)
    by_instrument = any(INSTRUMENT in effect.slots for effect in effects)
    seen = poses.states.seen_at(observed.tip[:, :3, 3]) if by_instrument else poses.states
    for k, effect in enumerate(effects):
        for term in effect.terms:
            states = seen if term.slot == INSTRUMENT else poses.states
            yield k, known.index(term.slot), AXES.index(term.axis), term.weight * states.value(term.basis)


def linearise(
    model: ErrorModel, poses: Poses, theta: Array, placement: Placement, rotation_weight: float, use: Mask
) -> Linearised:
    """The weighted problem at one point; `use` (N,) says which poses count. Free joints are solved and eliminated."""
    table = poses.dataset.q
    poses = solve_joints(model, poses, theta, placement)
    observed = observe(model, poses, theta, placement)
    residual = measured_minus(observed, poses.dataset)
    weights = np.isfinite(residual) * use[:, None].astype(float) * observed.scales(rotation_weight)
    blocks, names = placement_columns(poses, observed, placement)
    if free_joints(model.mechanism):
        blocks.append(effect_columns(model.effects, model, poses, observed))
        columns = np.concatenate(blocks, axis=2)
        dense = _Dense(columns, residual, weights, tuple(names), table)
        return _eliminated(model, placement, poses, observed, dense)
    rows = weights > 0
    weight = weights[rows]
    # one effect after the other in memory: columns of thousands of poses by hundreds of effects are there only once
    weighted = np.zeros((len(names) + len(model.effects), len(weight))).T
    weighted[:, : len(names)] = np.concatenate(blocks, axis=2)[rows] * weight[:, None]
    add_effect_rows(weighted.T[len(names) :], model.effects, model, poses, observed, weights)
    return Linearised(
        columns=weighted,
        residual=residual[rows] * weight,
        pose_of_row=np.nonzero(rows)[0],
        placement=len(names),
        placement_names=tuple(names),
        observed=observed,
        poses=poses,
        sizes=np.sqrt(np.einsum("km,km->k", weighted.T, weighted.T)),
        weights=weights,
    )


def residual_at(problem: Linearised, model: ErrorModel, theta: Array, placement: Placement) -> Linearised:
    """A problem without free joints, with the weighted residual at another point and its columns as they are."""
    observed = observe(model, problem.poses, theta, placement)
    rows = problem.weights > 0
    residual = measured_minus(observed, problem.poses.dataset)[rows] * problem.weights[rows]
    return replace(problem, residual=residual, observed=observed)


@dataclass(frozen=True)
class _Dense:
    """Columns (N, m, P), residual and weights (N, m) of every pose; names: of the columns of the placement; table:
    (N, J) joint values as read."""

    columns: Array
    residual: Array
    weights: Array
    names: tuple[str, ...]
    table: Array


def _eliminated(model: ErrorModel, placement: Placement, poses: Poses, observed: Observed, dense: _Dense) -> Linearised:
    """The linear problem of what the free joints of each pose leave."""
    weights, count = dense.weights, len(dense.names)
    measured = weights > 0
    joints = joint_columns(model.mechanism, observed)
    left = complement(joints * weights[:, :, None], measured)
    weighted = dense.columns * weights[:, :, None]
    sizes = np.linalg.norm(weighted, axis=(0, 1))
    rows = without_eliminated(left.rows(weighted), sizes)
    bare = observe(ErrorModel(model.mechanism, ()), poses, np.zeros(0), placement)
    nominal = np.concatenate(placement_columns(poses, bare, placement)[0], axis=2) * weights[:, :, None]
    rest = complement(joint_columns(model.mechanism, bare) * weights[:, :, None], measured).rows(nominal)
    rows[:, :count] = observable(left.rows(weighted[:, :, :count]), rest, sizes[:count])
    readings = joint_readings(model.mechanism, observed, dense.table - poses.dataset.q, weighted, weights)
    return Linearised(
        columns=rows,
        residual=left.rows(np.where(measured, dense.residual, 0.0) * weights),
        pose_of_row=np.nonzero(left.keep)[0],
        placement=count,
        placement_names=dense.names,
        observed=observed,
        poses=poses,
        sizes=sizes,
        weights=left.keep.astype(float),
        left=Left(left, weights, readings),
    )


def placement_columns(poses: Poses, observed: Observed, placement: Placement) -> tuple[list[Array], list[str]]:
    """Columns (N, m, P) of registration, tool and what instruments have of their own, in blocks, and their names."""
    data = poses.dataset
    blocks: list[Array] = []
    names: list[str] = []
    if any(kind.absolute for kind in observed.kinds):
        turn = observed.registration_sensitivity(observed.tip[:, :3, 3].mean(axis=0))
        for name in placement.registration:
            blocks.append(turn * (data.label("setup") == name)[:, None, None])
            names += [f"registration{f' {name}' if name else ''} {axis}" for axis in AXES]
    axes = _tool_axes(observed)
    tool = observed.tool_sensitivity()[:, :, :axes]
    for name in placement.tool:
        blocks.append(tool * (data.label("tool") == name)[:, None, None])
        names += [f"tool{f' {name}' if name else ''} {axis}" for axis in AXES[:axes]]
    for kind in observed.kinds:
        if kind.own:
            blocks.append(observed.own_sensitivity(kind))
            names += [f"{key} {own}" for key, each in kind.own.items() for own in each]
    return blocks, names


def _tool_axes(observed: Observed) -> int:
    """How many components of the tool's pose anything shows: its point, or its axes as well."""
    return 6 if any(kind.oriented for kind in observed.kinds) else 3


def placement_after(observed: Observed, placement: Placement, step: Array) -> Placement:
    """The placement moved by a step (P,), m and rad, of the columns `linearise` gives it, in their order.

    Registrations turn about the middle of the predicted points, tools in their own axes; orientations stay rotations.
    """
    i = 0
    registration, tool, anchors = dict(placement.registration), dict(placement.tool), dict(placement.anchors)
    centre = observed.tip[:, :3, 3].mean(axis=0)
    if any(kind.absolute for kind in observed.kinds):
        for name, frame in registration.items():
            registration[name] = se3.shift(centre) @ se3.exp(step[i : i + 6]) @ se3.shift(-centre) @ frame
            i += 6
    axes = _tool_axes(observed)
    for name, frame in tool.items():
        twist = np.zeros(6)
        twist[:axes] = step[i : i + axes]
        tool[name] = frame @ se3.exp(twist)
        i += axes
    for kind in observed.kinds:
        for key, names in kind.own.items():
            anchors[key] = kind.moved(key, observed.own[key], step[i : i + len(names)])
            i += len(names)
    return Placement(registration, tool, anchors)
