"""Measurement poses worth taking."""

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import linearise
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.workspace import joint_range, random_poses
from gpmodel.model.error_model import ErrorModel, Placement, prepare
from gpmodel.model.geometric import geometric_effects
from gpmodel.numerics import rank as ident
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import Dataset

POOL = 20
MARGIN = 0.02
PARAMETER_LIMIT = 1e4
EXCHANGES = 200


def candidates(mechanism: Mechanism, count: int, rng: np.random.Generator, above: float = -np.inf) -> Array:
    """Random joint values (count, n) a little inside the limits, tips not below `above` (m, along root z)."""
    chosen: list[Array] = []
    found = 0
    for _ in range(50):
        q = random_poses(mechanism, count, rng)
        middle = np.array([sum(joint_range(j)) / 2 for j in mechanism.joints])
        q = middle + (1.0 - MARGIN) * (q - middle)
        keep = chain(mechanism.transforms(q))[-1][:, 2, 3] >= above
        chosen.append(q[keep])
        found += int(keep.sum())
        if found >= count:
            return np.vstack(chosen)[:count]
    raise InputError(
        f"{found} of {50 * count} random poses of {mechanism.name} are above it; expected a lower plane", "above"
    )


def coordinates(mechanism: Mechanism, q: Array) -> Array:
    """Where a pose is, (N, n + 3): joint values over their ranges, and the tip over its greatest spread."""
    ranges = np.array([max(joint_range(j)[1] - joint_range(j)[0], 1e-9) for j in mechanism.joints])
    tips = chain(mechanism.transforms(q))[-1][:, :3, 3]
    return np.hstack([q / ranges, tips / max(float(np.ptp(tips, axis=0).max()), 1e-9)])


def spread_poses(mechanism: Mechanism, count: int, rng: np.random.Generator, above: float = -np.inf) -> Array:
    """Joint values (count, n) that differ as much as possible from one another: the equal distribution criterion.

    From a pool of random poses, each next one is the farthest from those chosen, in joint values and tip position
    together, so the smallest difference between any two is nearly as large as it can be (within a factor 2).
    Source: Robertson (2003), 3.3.3; Gonzalez (1985).
    """
    pool = candidates(mechanism, max(POOL * count, 400), rng, above)
    where = coordinates(mechanism, pool)
    chosen = [int(np.argmin(np.linalg.norm(where - where.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(where - where[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(where - where[chosen[-1]], axis=1))
    return pool[chosen]


def spacing(mechanism: Mechanism, q: Array) -> float:
    """Smallest difference between two poses, in the measure of `coordinates`; infinite for one pose."""
    where = coordinates(mechanism, q)
    distance = np.linalg.norm(where[:, None] - where[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return float(distance.min())


def geometric_columns(mechanism: Mechanism, q: Array) -> Array:
    """Columns (N, 3, K) of the tip's position for registration, tool and the geometric errors poses can tell apart,
    scaled to unit RMS; at the nominal geometry with a tool point off the last axis."""
    count = len(q)
    unmeasured = np.full((count, 3), np.nan)
    names = tuple(j.name for j in mechanism.joints)
    tool = np.eye(4)
    tool[:3, 3] = (0.05, 0.07, 0.11)
    tips = (chain(mechanism.transforms(q))[-1] @ tool)[:, :3, 3]
    data = Dataset(names, q, tips, unmeasured, np.arange(1, count + 1), np.zeros(count))
    model = ErrorModel(mechanism, geometric_effects(mechanism))
    problem = linearise(
        model, prepare(mechanism, data), np.zeros(len(model.effects)), Placement({"": np.eye(4)}, {"": tool}, {}),
        1.0, np.ones(count, dtype=bool),
    )  # fmt: skip
    placed, errors = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    kept = ident.rank(placed, errors).kept(PARAMETER_LIMIT)
    columns = np.hstack([placed[:, ident.rank(placed[:, :0], placed).kept(PARAMETER_LIMIT)], errors[:, kept]])
    blocks = np.zeros((count, 3, columns.shape[1]))
    row = np.arange(len(columns)) - np.searchsorted(problem.pose_of_row, problem.pose_of_row)
    blocks[problem.pose_of_row, row] = columns / np.sqrt(np.mean(columns**2, axis=0))
    return blocks


def observable_poses(mechanism: Mechanism, count: int, rng: np.random.Generator, above: float = -np.inf) -> Array:
    """Joint values (count, n) that make the geometric errors as well determined as possible: D-optimal.

    Maximises log det Σ JᵀJ over a pool of random poses, starting from the spread ones, exchanging the pose that
    adds least for the one that adds most. Source: Fedorov (1972); Borm and Menq (1991).
    Raises InputError for fewer poses than geometric errors need.
    """
    pool = np.vstack(
        [spread_poses(mechanism, count, rng, above), candidates(mechanism, max(POOL * count, 600), rng, above)]
    )
    columns = geometric_columns(mechanism, pool)
    unknowns = columns.shape[2]
    if 3 * count <= unknowns:
        raise InputError(f"{count} poses give {3 * count} values for {unknowns} unknowns; expected more poses", "count")
    chosen = np.arange(count)
    information = np.einsum("nij,nik->jk", columns[chosen], columns[chosen]) + 1e-9 * np.eye(unknowns)
    for _ in range(EXCHANGES):
        inverse = linalg.inv(information)
        gains = _log_determinants(columns, inverse, 1.0)
        gains[chosen] = -np.inf
        enter = int(np.argmax(gains))
        grown = information + columns[enter].T @ columns[enter]
        losses = _log_determinants(columns[chosen], linalg.inv(grown), -1.0)
        leave = int(np.argmax(losses))
        if gains[enter] + losses[leave] < 1e-6:
            break
        out = chosen[leave]
        chosen[leave] = enter
        information = grown - columns[out].T @ columns[out]
    return pool[chosen]


def _log_determinants(columns: Array, inverse: Array, sign: float) -> Array:
    """Change (N,) of log det M on adding (sign 1) or removing (-1) each pose: log det (I ± J M⁻¹ Jᵀ)."""
    inner = np.eye(3) + sign * columns @ inverse @ np.swapaxes(columns, 1, 2)
    return np.linalg.slogdet(inner)[1]
