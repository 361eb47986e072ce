"""Eliminate joints without a sensor: their values in the table are approximate, and are unknowns of every pose.

The unknown joint values are eliminated pose by pose (variable projection). A = U S Vᵀ are the weighted sensitivities
of one pose's measurements to its unmeasured joints. Only the measurements along columns of U with a negligible singular
value still inform the model. Errors of the joint values explain any residual along the other columns. Source:
Golub and Pereyra (1973); the truncation takes the place of 1/S in Robertson (2003), Fig 3.17.
"""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.model.observation import Orientation, Weights
from gpmodel.model.observed import Observed
from gpmodel.table.dataset import Dataset

TRUNCATION = 1e-2
"""Least singular value, relative to the largest, of a joint direction that the measurements determine. Along other
joint directions the table's joint values are kept."""

ELIMINATED = 1e-2
"""Least part of a column (parameter) that unmeasured joints do not absorb. Columns with less are set to 0."""

ROUNDING = 1e-7
"""Relative singular value below which a combination of parameters is a rounding error: √ of double precision."""
PRIOR_SIGMA = {"revolute": np.radians(1.0), "prismatic": 1e-3}
"""Default standard deviation of approximate joint values, rad and m, as if read from a scale by eye."""
ROTATION_WEIGHT = 0.3
"""Weight of a radian of orientation, m: a typical lever from wrist to tool."""
STARTING_WEIGHTS: Weights = {Orientation.name: ROTATION_WEIGHT}
"""Weights of kinds of measurements at the start of a fit, which replaces the weights by estimates."""
MAX_ITERATIONS = 20
"""Largest number of Gauss-Newton steps to solve the joint values of a pose; three are usual."""
STEP_TOLERANCE = 1e-9
"""Change of the joint values, rad or m, at which iteration ends: less than a nanometre at the tool."""
MINIMUM_POSES = 4
"""Least number of measured points that determine a sphere."""


def free_joints(mechanism: Mechanism) -> tuple[int, ...]:
    """Return the indices of the joints without a sensor, whose values in the table are approximate."""
    return tuple(i for i, joint in enumerate(mechanism.joints) if not joint.measured)


def prior_sigmas(mechanism: Mechanism) -> Array:
    """Return the prior standard deviations of unmeasured joints, 1 deg or 1 mm; only their ratios matter."""
    return np.array([PRIOR_SIGMA[mechanism.joints[i].kind] for i in free_joints(mechanism)])


def joint_columns(mechanism: Mechanism, observed: Observed) -> Array:
    """Return the derivatives of each pose's measurements with respect to its unmeasured joints, through the joints'
    drives."""
    free = free_joints(mechanism)
    out = np.zeros((len(observed.tip), observed.components, len(free)))
    for k, i in enumerate(free):
        for slot, axis, weight in mechanism.joints[i].drive:
            sensitivity = observed.sensitivity(mechanism.slots.index(slot))
            out[:, :, k] += weight * sensitivity[:, :, AXES.index(axis)]
    return out


@dataclass(frozen=True)
class Complement:
    """Directions of each pose's measurements that its unmeasured joints do not move.

    turn: orthonormal matrix of each pose that rotates its measured components.
    keep: mask, by pose, of the rotated components that are insensitive to unmeasured joints.
    """

    turn: Array
    keep: Mask

    def rows(self, values: Array) -> Array:
        """Return the rows of weighted measurements that unmeasured joints do not move."""
        turned: Array = np.einsum("nij,nj->ni", self.turn, values) if values.ndim == 2 else self.turn @ values
        return turned[self.keep]

    def components(self, rows: Array) -> Array:
        """Return measured components by pose from rows of `rows`, zero along the motions of unmeasured joints."""
        turned = np.zeros((*self.keep.shape, *rows.shape[1:]))
        turned[self.keep] = rows
        return np.asarray(np.einsum("nij,ni...->nj...", self.turn, turned))

    @property
    def shares(self) -> Array:
        """Part of each measured component, by pose, that unmeasured joints do not move, between 0 and 1."""
        return np.asarray(np.einsum("nij,ni->nj", self.turn**2, self.keep.astype(float)))


def complement(columns: Array, measured: Mask) -> Complement:
    """Return the directions of measurements that unmeasured joints do not move. columns: weighted derivatives with
    respect to unmeasured joints. measured: mask of measured components."""
    largest = np.linalg.norm(columns, axis=(1, 2))
    absent = np.where(measured, 0.0, np.where(largest > 0, largest, 1.0)[:, None])
    blocks = np.concatenate([columns, np.eye(measured.shape[1]) * absent[:, :, None]], axis=2)
    u, s, _ = np.linalg.svd(blocks, full_matrices=True)
    spread = np.where(largest > 0, largest, 1.0)[:, None]
    return Complement(np.swapaxes(u, 1, 2), s[:, : measured.shape[1]] <= TRUNCATION * spread)


def eliminate(columns: Array, residual: Array, joints: Array) -> tuple[Array, Array, IntArray]:
    """Eliminate the unmeasured joints of each pose from columns and residual. joints: derivatives with respect to the
    unmeasured joints.

    Returns columns, residual and the index of the pose of each row. Columns of which the joints absorb over 99 % are
    set to zero. NaN in the residual marks a missing measurement.
    """
    measured = np.isfinite(residual)
    left = complement(joints * measured[:, :, None], measured)
    blocks = columns * measured[:, :, None]
    rows = without_eliminated(left.rows(blocks), np.linalg.norm(blocks, axis=(0, 1)))
    return rows, left.rows(np.where(measured, residual, 0.0)), np.nonzero(left.keep)[0]


def without_eliminated(rows: Array, sizes: Array) -> Array:
    """Set columns to zero whose norm, after elimination of unmeasured joints, is below 1 % of the norm `sizes`
    before."""
    return np.where(np.linalg.norm(rows, axis=0) > ELIMINATED * sizes, rows, 0.0)


def observable(rows: Array, nominal: Array, sizes: Array) -> Array:
    """Project out of derivatives the parameter combinations that unmeasured joints absorb in the nominal mechanism.

    nominal: columns without any effect, where an absorbed combination is zero up to rounding. With effects, the column
    of an absorbed combination is small but not zero, and would be fitted to noise. sizes: column norms before
    elimination, which make metres and radians comparable.
    """
    scale = np.where(sizes > 0, sizes, 1.0)
    _, s, vt = np.linalg.svd(nominal / scale, full_matrices=True)
    rank = int(np.sum(s > ROUNDING))
    return np.asarray(rows / scale @ vt[:rank].T @ vt[:rank] * scale)


def solve_joints(
    model: ErrorModel, poses: Poses, theta: Array, placement: Placement, weights: Weights = STARTING_WEIGHTS
) -> Poses:
    """Return the poses with the values of unmeasured joints solved against the measurements.

    Of the joint values q that fit the measurements of a pose best, those nearest to the table's are selected, in units
    σ of `prior_sigmas`. The truncated Gauss-Newton step is σ (V S⁺ Uᵀ r + (I - V V⁺) (q_table - q) / σ), with residual
    r and singular value decomposition U S Vᵀ of the weighted derivatives by q / σ. Joint values in rows without a
    measurement are unchanged.
    """
    free = list(free_joints(model.mechanism))
    if not free:
        return poses
    sigma, start, current = prior_sigmas(model.mechanism), poses.dataset.q[:, free], poses
    shapes_move = any(not effect.constant for effect in model.effects)
    for _ in range(MAX_ITERATIONS):
        observed = observe(model, current, theta, placement)
        residual = measured_minus(observed, current.dataset)
        weight = np.isfinite(residual).astype(float) * observed.scales(weights)
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


def without_joint_motion(mechanism: Mechanism, observed: Observed, measured: Mask, values: Array) -> Array:
    """Remove from measurements, m, or columns the part that each pose's unmeasured joints explain.

    Without unmeasured joints nothing is removed. values: values of all measured components, or of the first few.
    """
    if not free_joints(mechanism):
        return values
    joints = joint_columns(mechanism, observed)[:, : values.shape[1]]
    left = complement(joints * measured[:, :, None], measured)
    seen = (values.T * measured.T).T
    turned = (np.einsum("nij,nj...->ni...", left.turn, seen).T * left.keep.T).T
    return np.asarray(np.einsum("nij,ni...->nj...", left.turn, turned))


def check_points(dataset: Dataset) -> None:
    """Raise InputError if free joints explain every measured point; the message states the needed measurements."""
    if flaw := points_flaw(dataset):
        raise InputError(flaw)


def points_flaw(dataset: Dataset) -> str | None:
    """Return the reason why unmeasured joints alone could explain every measured point, or None."""
    points = dataset.position[np.isfinite(dataset.position).all(axis=1)]
    if not len(points) and (dataset.has_rotation or dataset.distances or dataset.observations):
        return None
    return sphere_flaw(points, dataset.source)


def sphere_flaw(points: Array, where: str) -> str | None:
    """Return the reason why points determine no sphere (fewer than 4, equal, or coplanar), or None."""
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
