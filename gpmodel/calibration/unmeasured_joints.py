"""Joints without a sensor: their angles are approximate, so every pose's own angles are unknowns too.

They are eliminated pose by pose (variable projection). With the weighted sensitivities A (m, n) of one pose to
its own free joints and A = U S Vᵀ, only the observations along the columns of U with a negligible singular value
still speak of the model; what lies in the span of the others, any angle error would explain as well.
Source: Golub and Pereyra (1973); the truncation takes the place of 1/S in Robertson (2003), Fig 3.17.
"""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.model.observed import Observed
from gpmodel.table.dataset import Dataset

TRUNCATION = 1e-2
"""Least singular value over the largest of joint motions that the readings determine. Other directions keep their
prior."""

ELIMINATED = 1e-2
"""Least share of a column that free joint angles do not absorb. With less it cannot be estimated together with them."""

ROUNDING = 1e-7
"""Singular value over the largest below which a combination is rounding: the square root of double precision."""
PRIOR_SIGMA = {"revolute": np.radians(1.0), "prismatic": 1e-3}
"""Standard deviation of approximate joint values where none is stated, radians and metres: read from a scale by eye."""
ROTATION_WEIGHT = 0.3
"""Metres that count as a radian of orientation: a typical lever from the wrist to the tool. The fit of a table replaces
it by the ratio of its residuals."""
MAX_ITERATIONS = 20
"""Largest number of steps for the joints of a pose; three are usual."""
STEP_TOLERANCE = 1e-9
"""Step that ends the iteration, radians or metres: less than a nanometre at the tool."""
MINIMUM_POSES = 4
"""Poses that fix a sphere: fewer points lie on many."""


def free_joints(mechanism: Mechanism) -> tuple[int, ...]:
    """Indices of the joints whose table values are approximate."""
    return tuple(i for i, joint in enumerate(mechanism.joints) if not joint.measured)


def prior_sigmas(mechanism: Mechanism) -> Array:
    """Weak prior (n,) of the free joints' table values: 1 deg or 1 mm; only its ratios matter where both occur."""
    return np.array([PRIOR_SIGMA[mechanism.joints[i].kind] for i in free_joints(mechanism)])


def joint_columns(mechanism: Mechanism, observed: Observed) -> Array:
    """Sensitivity (N, m, n) of each pose's observations to its own free joints, through their drives."""
    free = free_joints(mechanism)
    out = np.zeros((len(observed.tip), observed.components, len(free)))
    for k, i in enumerate(free):
        for slot, axis, weight in mechanism.joints[i].drive:
            sensitivity = observed.sensitivity(mechanism.slots.index(slot))
            out[:, :, k] += weight * sensitivity[:, :, AXES.index(axis)]
    return out


@dataclass(frozen=True)
class Complement:
    """Complement of the free joints in each pose's observations.

    turn: (N, m, m), rows orthonormal.
    keep: (N, m), the turned observations that no free joint moves.
    """

    turn: Array
    keep: Mask

    def rows(self, values: Array) -> Array:
        """Weighted observations (N, m, ...) as the kept rows (M, ...)."""
        turned: Array = np.einsum("nij,nj->ni", self.turn, values) if values.ndim == 2 else self.turn @ values
        return turned[self.keep]


def complement(columns: Array, measured: Mask) -> Complement:
    """The complement of weighted joint columns (N, m, n); what is not `measured` (N, m) is left out as well."""
    largest = np.linalg.norm(columns, axis=(1, 2))
    absent = np.where(measured, 0.0, np.where(largest > 0, largest, 1.0)[:, None])
    blocks = np.concatenate([columns, np.eye(measured.shape[1]) * absent[:, :, None]], axis=2)
    u, s, _ = np.linalg.svd(blocks, full_matrices=True)
    spread = np.where(largest > 0, largest, 1.0)[:, None]
    return Complement(np.swapaxes(u, 1, 2), s[:, : measured.shape[1]] <= TRUNCATION * spread)


def eliminate(columns: Array, residual: Array, joints: Array) -> tuple[Array, Array, IntArray]:
    """Columns (N, m, K) and residual (N, m) less what each pose's own joints (N, m, n) explain.

    Returns rows (M, K), rows (M,) and the pose (M,) of each row. Columns that the joints absorb, up to ELIMINATED,
    come back exactly zero. NaN in the residual means not measured.
    """
    measured = np.isfinite(residual)
    left = complement(joints * measured[:, :, None], measured)
    blocks = columns * measured[:, :, None]
    rows = without_eliminated(left.rows(blocks), np.linalg.norm(blocks, axis=(0, 1)))
    return rows, left.rows(np.where(measured, residual, 0.0)), np.nonzero(left.keep)[0]


def without_eliminated(rows: Array, sizes: Array) -> Array:
    """Columns (M, K) with those set to zero whose norm is below ELIMINATED of `sizes` (K,), that before elimination."""
    return np.where(np.linalg.norm(rows, axis=0) > ELIMINATED * sizes, rows, 0.0)


def observable(rows: Array, nominal: Array, sizes: Array) -> Array:
    """Columns (M, K) without the combinations that the free joints absorb in the nominal mechanism.

    nominal: (M', K), the same columns without any effect, where an absorbed combination is zero but for rounding.
    Effects as small as they are would let such a combination be fitted to noise. sizes: (K,) column norms before
    elimination, which make metres and radians comparable.
    """
    scale = np.where(sizes > 0, sizes, 1.0)
    _, s, vt = np.linalg.svd(nominal / scale, full_matrices=True)
    rank = int(np.sum(s > ROUNDING))
    return np.asarray(rows / scale @ vt[:rank].T @ vt[:rank] * scale)


def solve_joints(model: ErrorModel, poses: Poses, theta: Array, placement: Placement) -> Poses:
    """Return the poses with their free joints solved against the measurements.

    Per pose: the values nearest to the table's (in units of `prior_sigmas`) among those that fit the
    observations best, by truncated Gauss-Newton:  δ = σ (V S⁺ Uᵀ r + (I - V V⁺) (q_table - q) / σ).
    Poses without a free joint, and rows where nothing was measured, come back as they were.
    """
    free = list(free_joints(model.mechanism))
    if not free:
        return poses
    sigma, start, current = prior_sigmas(model.mechanism), poses.dataset.q[:, free], poses
    shapes_move = any(not effect.constant for effect in model.effects)
    for _ in range(MAX_ITERATIONS):
        observed = observe(model, current, theta, placement)
        residual = measured_minus(observed, current.dataset)
        weight = np.isfinite(residual).astype(float) * observed.scales(ROTATION_WEIGHT)
        columns = joint_columns(model.mechanism, observed) * weight[:, :, None] * sigma
        u, s, vt = np.linalg.svd(columns, full_matrices=False)
        good = s > TRUNCATION * np.maximum(s[:, :1], 1e-300)
        target = np.einsum("nik,ni->nk", u, np.nan_to_num(residual) * weight)
        pull = (start - current.dataset.q[:, free]) / sigma
        along = np.where(good, target / np.where(good, s, 1.0) - np.einsum("nkj,nj->nk", vt, pull), 0.0)
        step = (pull + np.einsum("nkj,nk->nj", vt, along)) * sigma
        step = np.clip(step, -0.5, 0.5)
        q = current.dataset.q.copy()
        q[:, free] += step
        data = replace(current.dataset, q=q)
        if shapes_move:
            current = prepare(model.mechanism, data, current.states)
        else:
            current = Poses(data, model.mechanism.transforms(q), current.states, current.tip_slot)
        if np.abs(step).max(initial=0.0) < STEP_TOLERANCE:
            break
    return current if shapes_move else prepare(model.mechanism, current.dataset, current.states)


def what_is_left(mechanism: Mechanism, observed: Observed, measured: Mask, values: Array) -> Array:
    """Observations (N, m), in metres, or columns (N, m, K), less what each pose's own free joints explain.

    Unchanged without any. m: all components that are observed, or the first few of them.
    """
    if not free_joints(mechanism):
        return values
    joints = joint_columns(mechanism, observed)[:, : values.shape[1]]
    left = complement(joints * measured[:, :, None], measured)
    seen = (values.T * measured.T).T
    turned = (np.einsum("nij,nj...->ni...", left.turn, seen).T * left.keep.T).T
    return np.asarray(np.einsum("nij,ni...->nj...", left.turn, turned))


def check_points(dataset: Dataset) -> None:
    """Refuses points from which free angles leave nothing. Raises InputError naming the table and what was expected."""
    if flaw := points_flaw(dataset):
        raise InputError(flaw)


def points_flaw(dataset: Dataset) -> str | None:
    """Reason why free angles explain every measured point; None if they do not."""
    points = dataset.position[np.isfinite(dataset.position).all(axis=1)]
    if not len(points) and (dataset.has_rotation or dataset.distances or dataset.observations):
        return None
    return sphere_flaw(points, dataset.source)


def sphere_flaw(points: Array, where: str) -> str | None:
    """Why points (N, 3) determine no sphere: fewer than 4, alike, coplanar; None where they do."""
    expected = f"expected at least {MINIMUM_POSES} different points that are not all in one plane"
    if len(points) < MINIMUM_POSES:
        return f"{where}: {len(points)} measured poses; {expected}"
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] <= 1e-9 * max(float(np.abs(points).max()), 1e-12):
        return f"{where}: one pose repeated {len(points)} times; {expected}"
    different = len(np.unique(np.round(points, 9), axis=0))
    if different < MINIMUM_POSES:
        return f"{where}: only {different} different points; {expected}"
    if spread[2] <= 1e-4 * spread[0]:
        return f"{where}: the points lie in one plane; {expected}"
    return None
