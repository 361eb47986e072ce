"""How much less poses say that depend on one another: repeats, stretches of rows, regions of space."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import contribution
from gpmodel.families.candidate import Candidate

PARTITIONS = 8
"""Ways to cut rows into stretches, and space into regions; sixteen tell no more."""
CHANCE = 1.645
"""Standard deviations that a normal deviate exceeds in one of twenty."""


def inflation(residual: Residual, candidate: Candidate) -> dict[str, float]:
    """How many times larger the variance of a candidate's coefficient is than if poses were independent, by what makes
    them depend on one another: repeats, stretches of rows, regions of space. At least 1.

    With s the product of the candidate's own contribution and what it leaves, summed over each pose: Σ_blocks (Σ s)² /
    Σ s², the ratio of cluster-robust to plain variance (Liang and Zeger 1986), its mean over several partitions into
    blocks, which is a kernel that falls with distance (Newey and West 1987; Conley 1999), less by how much it exceeds 1
    in one of twenty where poses are independent (experiments/coverage).
    """
    explained = contribution(residual, candidate)
    left = residual.values - explained * (explained @ residual.values / max(float(explained @ explained), 1e-300))
    score = np.zeros(len(residual.poses))
    rows = slice(0, residual.measured)
    np.add.at(score, residual.problem.pose_of_row, explained[rows] * left[rows])
    return {name: max(1.0, _least(score, blocks)) for name, blocks in _partitions(residual)}


def _least(score: Array, partitions: Sequence[IntArray]) -> float:
    """The ratio of a score (N,) less CHANCE of its standard deviations where signs are independent,

    var = 2 Σ_{i≠j} w_ij² s_i² s_j² / (Σ s²)²,   w_ij the share of partitions that have i and j in one block.
    """
    squares = score**2
    energy = max(float(squares.sum()), 1e-300)
    ratio = float(np.mean([np.sum(np.bincount(block, score) ** 2) for block in partitions])) / energy
    pairs = float(np.mean([_together(squares, a, b) for a in partitions for b in partitions]) - squares @ squares)
    return float(ratio - CHANCE * np.sqrt(2.0 * max(pairs, 0.0)) / energy)


def _together(squares: Array, block: IntArray, other: IntArray) -> float:
    """Sum of the products of any two squares (N,) that are in one block of both partitions."""
    code = block if other is block else block * (int(other.max()) + 1) + other
    return float(np.sum(np.bincount(code, squares) ** 2))


def order_matters(residual: Residual, candidate: Candidate) -> bool:
    """Whether rows share something that random folds would not part: they are in the order of measurement, or the
    candidate reads the row."""
    return residual.poses.states.past is not None or "row" in candidate.inputs


def _partitions(residual: Residual) -> Iterator[tuple[str, list[IntArray]]]:
    """Names of what poses may share, and blocks (N,) of each, in one or several ways."""
    count, poses = residual.criteria.blocks, len(residual.poses)
    if residual.unit_of_pose.max() + 1 < poses:
        yield "repeats", [residual.unit_of_pose]
    if poses >= 3 * count:
        place = np.argsort(np.argsort(residual.poses.states["row"], kind="stable"), kind="stable")
        shifts = np.arange(PARTITIONS) / PARTITIONS
        yield "rows", [np.floor(place * count / poses + shift).astype(np.int64) for shift in shifts]
        points = np.column_stack([residual.poses.states[axis] for axis in "xyz"])
        turns = Rotation.random(PARTITIONS, random_state=0).as_matrix()
        yield "space", [regions(points @ turn, count) for turn in turns]


def regions(points: Array, count: int) -> IntArray:
    """Region (N,) of each point (N, 3): halved at the median of their longest extent, the largest region first."""
    region = np.zeros(len(points), dtype=np.int64)
    for new in range(1, count):
        own = np.flatnonzero(region == np.argmax(np.bincount(region)))
        axis = int(np.argmax(np.ptp(points[own], axis=0)))
        order = np.argsort(points[own, axis], kind="stable")
        region[own[order[len(own) // 2 :]]] = new
    return region
