"""Selection of measurement poses before any measurement."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import CONDITION_LIMIT, linearised_at_nominal
from gpmodel.mechanism.branches import joint_range
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank as ident
from gpmodel.numerics.se3 import chain
from gpmodel.planning.design import LITTLE, Constraints, Criterion, Design, DOptimal, EOptimal, LOptimal, candidates
from gpmodel.table.dataset import Dataset, unmeasured

STEPS = 300
"""Largest number of multiplicative steps in the computation of the optimal weights of poses."""

CLOSE = 0.01
"""Largest relative gap between lower bound and best variance of a design, half a per cent of the standard deviation."""


def least_deviation(questions: Sequence[Design], count: int) -> float:
    """Return a lower bound of the largest standard deviation of the design problems, over all choices of `count` poses.

    The lower bound holds even if a pose is measured twice. Raises TypeError if a criterion is not a Variance. A
    selection of n poses is a measure of mass n over the pool. The variance is convex in the information matrix, so that
    the tangent at any measure is a lower bound for every selection; at the best measure the bound is nearly reached.
    Sources: Kiefer and Wolfowitz (1960); the multiplicative steps, Silvey, Titterington and Torsney (1978), Yu (2010).
    """
    return max(_least(question, count) for question in questions)


def _least(question: Design, count: int) -> float:
    if not isinstance(question.criterion, LOptimal):
        raise TypeError("the criterion must be LOptimal")
    columns, weight = question.columns, question.criterion.weight
    known = question.known + LITTLE * np.eye(len(question.known))
    share, best = np.full(len(columns), 1.0 / len(columns)), 0.0
    for _ in range(STEPS):
        rows = (columns * np.sqrt(share)[:, None, None]).reshape(-1, columns.shape[2])
        inverse = linalg.inv(known + count * rows.T @ rows)
        variance = float(np.trace(inverse @ weight))
        slope = np.sum((columns @ (inverse @ weight @ inverse)) * columns, axis=(1, 2))
        mean = float(share @ slope)
        best = max(best, variance - count * (float(slope.max()) - mean))
        if best > (1.0 - CLOSE) * variance:
            break
        share = share * np.sqrt(slope / mean)
        share /= share.sum()
    return float(np.sqrt(best))


POOL, SMALLEST_POOL, LARGEST_POOL = 20, 600, 10_000
"""Number of candidate poses for each wanted pose; least size of the pool of candidates; largest size of the pool, if
two candidates for each wanted pose fit."""


def coordinates(mechanism: Mechanism, q: Array) -> Array:
    """Return coordinates (poses, joints + 3) that measure the distance between poses.

    The coordinates are joint values relative to the joint ranges, and tip positions relative to their largest spread.
    """
    ranges = np.array([max(joint_range(j)[1] - joint_range(j)[0], 1e-9) for j in mechanism.joints])
    tips = chain(mechanism.transforms(q))[-1][:, :3, 3]
    return np.hstack([q / ranges, tips / max(float(np.ptp(tips, axis=0).max()), 1e-9)])


def pool_of(mechanism: Mechanism, count: int, rng: np.random.Generator, reach: Constraints | None = None) -> Array:
    """Draw a pool of random joint values (poses, joints), from which `count` poses are selected.
    Raises InputError as `candidates` does."""
    return candidates(mechanism, max(min(POOL * count, LARGEST_POOL), 2 * count, SMALLEST_POOL), rng, reach, count)


def spread_poses(mechanism: Mechanism, count: int, rng: np.random.Generator, reach: Constraints | None = None) -> Array:
    """Select joint values (count, joints) that differ as much as possible from one another: the equal distribution
    criterion.

    From a pool of random poses, each further pose is the pose farthest from the selected poses, in joint values and tip
    position together. The smallest distance between two poses is within a factor 2 of the largest possible distance.
    Source: Robertson (2003), 3.3.3; Gonzalez (1985).
    """
    pool = candidates(mechanism, max(POOL * count, 400), rng, reach, count)
    return pool[spread_among(mechanism, pool, count)]


def spread_among(mechanism: Mechanism, pool: Array, count: int, taken: Array | None = None) -> IntArray:
    """Return the indices of `count` poses of a pool (poses, joints) far from one another and from the poses `taken`.

    If `taken` is empty, the first selected pose is the pose nearest to the mean of the pool.
    """
    before = 0 if taken is None else len(taken)
    where = coordinates(mechanism, pool if taken is None else np.vstack([taken, pool]))
    where, there = where[before:], where[:before]
    if before:
        distance = np.min(np.linalg.norm(where[:, None] - there[None], axis=2), axis=1)
        chosen = [int(np.argmax(distance))]
        distance = np.minimum(distance, np.linalg.norm(where - where[chosen[0]], axis=1))
    else:
        chosen = [int(np.argmin(np.linalg.norm(where - where.mean(axis=0), axis=1)))]
        distance = np.linalg.norm(where - where[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(where - where[chosen[-1]], axis=1))
    return np.array(chosen, dtype=np.int64)


def spacing(mechanism: Mechanism, q: Array) -> float:
    """Return the smallest distance between two poses, in relative joint values and tip positions; or infinity."""
    where = coordinates(mechanism, q)
    return float(cKDTree(where).query(where, k=2)[0][:, 1].min())


def _at_points(mechanism: Mechanism, q: Array) -> Dataset:
    """Return a data set of poses q (poses, joints) whose measured positions are all zero."""
    return replace(unmeasured([j.name for j in mechanism.joints], q), position=np.zeros((len(q), 3)))


def geometric_columns(mechanism: Mechanism, q: Array) -> Array:
    """Return derivatives (poses, 3, unknowns) of the tip position with respect to registration, tool point and
    identifiable geometric constants.

    The derivatives are taken at the nominal geometry, with a tool point off the last axis, and scaled to unit RMS.
    """
    measured = _at_points(mechanism, q)
    problem = linearised_at_nominal(mechanism, geometric_effects(mechanism), measured)
    placed, errors = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    kept = ident.rank(placed, errors).kept(CONDITION_LIMIT)
    columns = np.hstack([placed[:, ident.rank(placed[:, :0], placed).kept(CONDITION_LIMIT)], errors[:, kept]])
    return _by_pose(problem.pose_of_row, columns / np.sqrt(np.mean(columns**2, axis=0)))


def _by_pose(pose_of_row: IntArray, columns: Array) -> Array:
    """Reshape columns (coordinates, unknowns) of positions into blocks (poses, 3, unknowns), one per pose."""
    blocks = np.zeros((pose_of_row.max() + 1, 3, columns.shape[1]))
    blocks[pose_of_row, np.arange(len(columns)) - np.searchsorted(pose_of_row, pose_of_row)] = columns
    return blocks


def variance_root(columns: Array) -> Array:
    """Return the matrix L for which trace(L covariance) is the mean variance of the tool point over a pool of poses."""
    return np.asarray(np.einsum("pij,pik->jk", columns, columns)) / len(columns)


GOALS: dict[str, Callable[[Array], Criterion]] = {
    "d-optimal": lambda columns: DOptimal(),
    "e-optimal": lambda columns: EOptimal(),
    "i-optimal": lambda columns: LOptimal(variance_root(columns)),
}
"""{name: function that returns the criterion of a design}. Argument: derivatives (poses, 3, unknowns) of a pool."""


def geometric_problem(mechanism: Mechanism, pool: Array, noise: float) -> Design:
    """Return the I-optimal design problem of the tool position, m, over a pool, with unknown geometric constants.

    pool: joint values (poses, joints).
    noise: standard deviation of one coordinate, m.
    """
    columns = geometric_columns(mechanism, pool)
    goal = LOptimal(noise**2 * variance_root(columns))
    return Design(columns, np.zeros((columns.shape[2], columns.shape[2])), goal)


def type_problem(prior: ErrorModel, pool: Array) -> Design:
    """Return the I-optimal design problem of the tool position, m, over a pool, for a machine of a known type.

    Registration and tool of the machine are unknown. Effects that depend on inputs other than the pose are omitted.
    prior: effects with their standard deviation between machines of the type, and the noise.
    """
    mechanism, data, noise = prior.mechanism, _at_points(prior.mechanism, pool), prior.noise or 1.0
    known = set(prepare(mechanism, data).states.columns)
    effects = tuple(e for e in prior.effects if known.issuperset(e.inputs))
    problem = linearised_at_nominal(mechanism, effects, data)
    deviation = np.concatenate([np.full(problem.placement, np.inf), [e.prior for e in effects]])
    scale = np.maximum(np.sqrt(np.mean(problem.columns**2, axis=0)), ident.NEGLIGIBLE) / noise
    columns = _by_pose(problem.pose_of_row, problem.columns / (noise * scale))
    return Design(columns, np.diag(1.0 / (deviation * scale) ** 2), LOptimal(noise**2 * variance_root(columns)))
