"""The weighted linear problem at one point: what every parameter does to every observation."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.start import placement_columns
from gpmodel.calibration.unmeasured_joints import (
    TRUNCATION,
    Complement,
    complement,
    free_joints,
    joint_columns,
    observable,
    prior_sigmas,
    solve_joints,
    without_eliminated,
)
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Mechanism, places
from gpmodel.model.effect import REGISTRATION, Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe
from gpmodel.model.observed import Observed
from gpmodel.numerics import rank as ident

LEAST_ERROR = 1e-6
"""Smallest error of a description that counts, in units of prior_sigmas: 3.6 milliarcseconds."""
LEAST_SIGMA = 1e-12
"""Smallest noise, m: below that of every table with rounding."""
ROUNDING = 1e-14
"""Smallest information on a column, relative to the largest."""


@dataclass(frozen=True)
class JointReadings:
    """Rows (B, K) and right side (B,) of the table's joint values, in units of `prior_sigmas`, zero along what no pose
    shows. shown: how many directions are."""

    rows: Array
    off: Array
    shown: int

    def error(self, used: int = 0) -> float:
        """τ: RMS of how far the values are off, where they determine so many unknowns."""
        return max(float(np.sqrt(np.sum(self.off**2) / max(self.shown - used, 1))), LEAST_ERROR)

    def alone(self, informed: Array, sigma: float) -> Array:
        """Combinations (B, W) of the readings, orthonormal, that tell more of something than the measurements do.

        informed: the other rows (M, K), measured and believed, each ± sigma. Of generalised eigenvectors v of
        RᵀR / τ² and that plus CᵀC / σ² those with more than half: R v of unit length.
        """
        told, read = informed / max(sigma, LEAST_SIGMA), self.rows / self.error()
        scale = np.sqrt(np.sum(told**2, axis=0) + np.sum(read**2, axis=0))
        scale = np.where(scale > 0, scale, 1.0)
        told, read = told / scale, read / scale
        inner = read.T @ read
        both = inner + told.T @ told + ROUNDING * np.eye(len(scale))
        share, vectors = linalg.eigh(inner, both, check_finite=False)
        more = share > 0.5
        return np.asarray(read @ vectors[:, more] / np.sqrt(share[more]))


def joint_readings(
    mechanism: Mechanism, observed: Observed, off: Array, columns: Array, weights: Array
) -> JointReadings:
    """The readings of the free joints at every pose.

    off: (N, J) joint values as read less those solved. columns: (N, m, K), weighted, before anything is eliminated;
    weights: (N, m), zero where a pose does not count or was not measured.

    With the weighted sensitivities A = U S Vᵀ (m, n) of one pose to its free joints, in units of `prior_sigmas`, a step
    of the parameters with columns C moves the joints that fit the measurements best by -V S⁺ Uᵀ C step. The values in
    the table are believed to differ from those by errors ~ N(0, τ²), so that

        R · step ≈ q_table - q_solved        R = -V S⁺ Uᵀ C, ± τ along the directions of V that the pose shows

    What the measurements tell less of than these readings do, as of a ball's turn about its own centre, is known from
    them alone; of everything else they are left out, so that it stays what eliminating free angles makes of it. τ shows
    in how far the solved joint values lie from the table's.
    """
    free, sigma = list(free_joints(mechanism)), prior_sigmas(mechanism)
    u, s, vt = np.linalg.svd(joint_columns(mechanism, observed) * weights[:, :, None] * sigma, full_matrices=False)
    shown = s > TRUNCATION * np.maximum(s[:, :1], 1e-300)
    inverse = np.where(shown, 1.0 / np.where(shown, s, 1.0), 0.0)
    moved = -np.einsum("nkj,nk,nik,nip->njp", vt, inverse, u, columns, optimize=True)
    seen = np.einsum("nki,nk,nkj,nj->ni", vt, shown, vt, off[:, free] / sigma, optimize=True)
    return JointReadings(moved.reshape(-1, columns.shape[2]), seen.ravel(), int(shown.sum()))


@dataclass(frozen=True)
class Linearised:
    """One weighted linear problem: columns (M, K) · step ≈ residual (M,), with what each row belongs to.

    The first `placement` columns are registration, tool and anchors; the others are the model's effects.
    Metres throughout: rotations are weighted by `rotation_weight`. observed: what was predicted. poses: those given,
    with free joints solved. sizes: (K,) norms of the weighted columns before each pose's free joints were eliminated.
    weights: (N, m), positive where an observation is a row; `left` is what free joints leave, None without any.
    ratio: noise over the standard deviation of a constant, 1/m, where both are known; None where they are not.
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
    ratio: float | None = None

    def free(self, kept: Mask) -> Mask:
        """The columns (K,) of the placement and of the effects that are kept (E,)."""
        return np.concatenate([np.ones(self.placement, dtype=bool), kept])

    @property
    def rigid(self) -> Mask:
        """The columns (P,) of registrations and tools among those of the placement."""
        return np.array([n.startswith(("registration", "tool")) for n in self.placement_names], dtype=bool)

    def effect_rows(self, effects: Sequence[Effect], model: ErrorModel) -> Array:
        """Columns (M, E) of any effects, weighted like the residual; those of the instrument less what registrations
        and tools take up of them."""
        if self.left is not None:
            rows = self.weigh(effect_columns(tuple(effects), model, self.poses, self.observed))
        else:
            out = np.zeros((len(effects), len(self.residual)))
            rows = add_effect_rows(out, effects, model, self.poses, self.observed, self.weights).T
        if own := [k for k, effect in enumerate(effects) if effect.of_the_instrument]:
            rigid = ident.orthonormal(self.columns[:, : self.placement][:, self.rigid])
            sizes = np.linalg.norm(rows[:, own], axis=0)
            rows[:, own] = without_eliminated(ident.remove(rigid, rows[:, own]), sizes)
        return rows

    def weigh(self, values: Array) -> Array:
        """Observations (N, m, ...) as rows (M, ...), weighted like the residual; what free joints absorb is zero."""
        shape = (*self.weights.shape, *([1] * (values.ndim - 2)))
        if self.left is not None:
            weighted = values * self.left.weights.reshape(shape)
            return without_eliminated(self.left.complement.rows(weighted), np.linalg.norm(weighted, axis=(0, 1)))
        return (values * self.weights.reshape(shape))[self.weights > 0]


@dataclass(frozen=True)
class Left:
    """Rows that remain after elimination of free joints.

    complement: remaining directions of the observations.
    weights: (N, m) weights before elimination.
    readings: information of the table's joint values.
    """

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
    """Every term of some effects: the effect's number, indices of slot and axis, weight times basis (N,). Then what
    registrations and tools take up of them."""
    known = places(model.mechanism)
    by_instrument = any(INSTRUMENT in effect.slots for effect in effects)
    seen = poses.states.seen_at(observed.tip[:, :3, 3]) if by_instrument else poses.states
    for k, effect in enumerate(effects):
        for term in effect.terms:
            states = seen if term.slot == INSTRUMENT else poses.states
            yield k, known.index(term.slot), AXES.index(term.axis), term.weight * states.value(term.basis)
        for rigid in effect.taken_up:
            at = known.index(INSTRUMENT) + (rigid.of != REGISTRATION)
            here = (poses.dataset.label(rigid.of) == rigid.label).astype(float)
            for axis, size in enumerate(rigid.twist):
                if size != 0.0:
                    yield k, at, axis, -size * here


def linearise(
    model: ErrorModel, poses: Poses, theta: Array, placement: Placement, rotation_weight: float, use: Mask
) -> Linearised:
    """The weighted problem at one point; `use` (N,) says which poses count. Free joints are solved and eliminated."""
    table = poses.dataset.q
    poses = solve_joints(model, poses, theta, placement)
    observed = observe(model, poses, theta, placement)
    if not free_joints(model.mechanism):
        return linearise_about(observed, model, poses, placement, rotation_weight, use)
    residual, weights = _weighted(observed, poses, rotation_weight, use)
    blocks, names = placement_columns(poses, observed, placement)
    blocks.append(effect_columns(model.effects, model, poses, observed))
    columns = np.concatenate(blocks, axis=2)
    dense = _Dense(columns, residual, weights, tuple(names), table)
    return _eliminated(model, placement, poses, observed, dense)


def linearise_about(
    observed: Observed, model: ErrorModel, poses: Poses, placement: Placement, rotation_weight: float, use: Mask
) -> Linearised:
    """Linearise about the predicted readings, without free joints."""
    residual, weights = _weighted(observed, poses, rotation_weight, use)
    blocks, names = placement_columns(poses, observed, placement)
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


def _weighted(observed: Observed, poses: Poses, rotation_weight: float, use: Mask) -> tuple[Array, Array]:
    """Measured minus observed (N, m), and the weight of each; 0 where nothing was measured."""
    residual = measured_minus(observed, poses.dataset)
    return residual, np.isfinite(residual) * use[:, None].astype(float) * observed.scales(rotation_weight)


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
