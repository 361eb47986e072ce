"""Cluster-robust variance inflation by dependent poses: repeats, stretches of rows, regions of space."""

from collections.abc import Iterator

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import contribution
from gpmodel.families.candidate import Candidate
from gpmodel.model.states import States
from gpmodel.table.bundles import stretches
from gpmodel.table.units import clock_names


def inflation(residual: Residual, candidate: Candidate) -> dict[str, float]:
    """Return the variance inflation (at least 1) of a candidate's coefficient by each kind of dependence.

    The kinds are repeats, stretches of rows and regions of space.

    With s the product of the candidate's own contribution and what it leaves, summed over each pose: Σ_blocks (Σ s)² /
    Σ s², the ratio of cluster-robust to plain variance (Liang and Zeger 1986), over what it is without dependence where
    poses have placed a body together (`_when_independent`); 1 where it is no further above 1 than two standard
    deviations √(2/blocks) of it under independence. One candidate in thirty is by chance: what reads no clock is held
    to be as much above as the model's own columns say (`_among`), of which none is slow by itself. A permutation of
    whole blocks stops less: what is slow within a block stays slow in any order of them (experiments/coverage).
    """
    explained = contribution(residual, candidate)
    left = residual.values - explained * (explained @ residual.values / max(float(explained @ explained), 1e-300))
    score = np.zeros(len(residual.poses))
    rows = slice(0, residual.measured)
    np.add.at(score, residual.problem.pose_of_row, explained[rows] * left[rows])
    slow = reads_a_clock(candidate, residual.poses.states)
    out, placed = {}, residual.placed_by_units * explained[rows, None]
    for name, block in _partitions(residual):
        ratio, count = float(_ratios(score[:, None], block)[0]), int(block.max()) + 1
        if placed.shape[1]:
            ratio /= _when_independent(explained[rows], placed, residual.problem.pose_of_row, block)
        out[name] = ratio = _if_above(ratio, count)
        if ratio > 1.0 and not slow:
            out[name] = float(np.clip(_among(residual, ratio, block), 1.0, ratio))
    return out


def reads_a_clock(candidate: Candidate, states: States) -> bool:
    """Return whether a candidate is a function of the rows or of the time."""
    return not clock_names(states.units).isdisjoint(candidate.inputs)


def _ratios(scores: Array, block: IntArray) -> Array:
    """Σ_blocks (Σ s)² / Σ s² (K,) of scores s (N, K) of the poses."""
    together = np.zeros((int(block.max()) + 1, scores.shape[1]))
    np.add.at(together, block, scores)
    return np.asarray(np.sum(together**2, axis=0) / np.maximum(np.sum(scores**2, axis=0), 1e-300))


def _if_above(ratio: float, count: int) -> float:
    """A ratio of so many independent sums, 1 where it is no further above 1 than two standard deviations of it."""
    return ratio if ratio > 1.0 + 2.0 * np.sqrt(2.0 / count) else 1.0


def _among(residual: Residual, ratio: float, block: IntArray) -> float:
    """A ratio drawn to the mean of those of the model's own columns, by what chance has of their variance.

    m + (ratio - m) τ² / (τ² + c), τ² = max(0, v - c), with m and v the mean and variance of their ratios and c =
    2 m²/blocks what each has under independence: where nothing depends on anything they are all one, where the
    instrument drifts they differ by how slow they are. Source: Efron and Morris (1973).
    """
    columns = residual.system[: residual.measured]
    scores = np.zeros((len(residual.poses), columns.shape[1]))
    np.add.at(scores, residual.problem.pose_of_row, columns * residual.values[: residual.measured, None])
    own, count = _ratios(scores, block), int(block.max()) + 1
    mean = _if_above(float(own.mean()), own.size * count)
    chance = 2.0 * mean**2 / count
    spread = max(0.0, float(own.var()) - chance)
    return mean + (ratio - mean) * spread / (spread + chance)


def _when_independent(explained: Array, placed: Array, pose: IntArray, block: IntArray) -> float:
    """The ratio (Σ_blocks (Σ s)²) / Σ s² to be expected of independent noise, of which what poses placed together, a
    bar, has taken the part along U: Σ_blocks (|e|² - |Uᵀe|²) over the same sum over poses. Both ends of a bar show the
    one length that is left of it, so that their products are the same number twice and the ratio is two.

    explained: e. placed: (M, k) rows of U times e. pose: (M,) of the rows. block: (N,) of the poses.
    """
    whole = float(explained @ explained)
    taken = []
    for code in (block[pose], pose):
        sums = np.zeros((int(code.max()) + 1, placed.shape[1]))
        np.add.at(sums, code, placed)
        taken.append(float(np.sum(sums**2)))
    return max(whole - taken[0], 1e-300) / max(whole - taken[1], 1e-300)


def order_matters(residual: Residual, candidate: Candidate) -> bool:
    """Return whether dependence between rows would survive random folds.

    Rows are in the order of measurement, or the candidate reads the row.
    """
    return residual.poses.states.past is not None or "row" in candidate.inputs


def _partitions(residual: Residual) -> Iterator[tuple[str, IntArray]]:
    """Names of what poses may share, and the block (N,) of each."""
    count, poses = residual.criteria.blocks, len(residual.poses)
    if residual.unit_of_pose.max() + 1 < poses:
        yield "repeats", residual.unit_of_pose
    if poses >= 3 * count:
        yield "rows", stretches(residual.poses.states["row"], count)
        yield "space", regions(np.column_stack([residual.poses.states[axis] for axis in "xyz"]), count)


def regions(points: Array, count: int) -> IntArray:
    """Region (N,) of each point (N, 3): halved at the median of their longest extent, the largest region first."""
    region = np.zeros(len(points), dtype=np.int64)
    for new in range(1, count):
        own = np.flatnonzero(region == np.argmax(np.bincount(region)))
        axis = int(np.argmax(np.ptp(points[own], axis=0)))
        order = np.argsort(points[own, axis], kind="stable")
        region[own[order[len(own) // 2 :]]] = new
    return region
