"""Estimate how unequal noise and dependent poses (repeats, rows, regions) inflate a coefficient's variance."""

from collections.abc import Iterator

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import contribution
from gpmodel.families.candidate import Candidate
from gpmodel.model.states import States
from gpmodel.table.blocks import stretches
from gpmodel.table.units import clock_names


def inflation(residual: Residual, candidate: Candidate) -> dict[str, float]:
    """Return the variance inflation (at least 1) of a candidate's coefficient by dependent repeats, rows and regions.

    The inflation is Σ_blocks (Σ s)² / Σ s², the ratio of cluster-robust to plain variance (Liang and Zeger 1986), with
    the score s of a pose: the candidate's contribution times the remaining residual, summed over the rows of the pose.
    The inflation is divided by its expectation for independent noise (`_when_independent`), and set to 1 unless it
    exceeds 1 by two standard deviations √(2/blocks), as one candidate in thirty does without dependence. The inflation
    of a candidate that does not depend on time is therefore shrunk to the mean of the model's columns (`_among`). A
    permutation of blocks corrects less: a drift within a block remains in any order of the blocks.

    For a formula without a name, "noise" is the ratio of the variances with unequal and equal noise of the poses (HC3
    of MacKinnon and White 1985): the search for a formula, which random signs do not repeat, prefers noisy poses.
    """
    explained = contribution(residual, candidate)
    left = residual.values - explained * (explained @ residual.values / max(float(explained @ explained), 1e-300))
    score = np.zeros(len(residual.poses))
    rows = slice(0, residual.measured)
    np.add.at(score, residual.problem.pose_of_row, explained[rows] * left[rows])
    slow = depends_on_time(candidate, residual.poses.states)
    out, placed = dict[str, float](), residual.block_registration * explained[rows, None]
    if not candidate.family:
        energy = np.bincount(residual.problem.pose_of_row, explained[rows] ** 2, len(score))
        apart = score / np.maximum(1.0 - energy / energy.sum(), 1e-9)
        out["noise"] = max(float(apart @ apart / (energy.sum() * np.mean(left[rows] ** 2))), 1.0)
    for name, block in _partitions(residual):
        ratio, count = float(_ratios(score[:, None], block)[0]), int(block.max()) + 1
        if placed.shape[1]:
            ratio /= _when_independent(explained[rows], placed, residual.problem.pose_of_row, block)
        out[name] = ratio = _if_above(ratio, count)
        if ratio > 1.0 and not slow:
            out[name] = float(np.clip(_among(residual, ratio, block), 1.0, ratio))
    return out


def depends_on_time(candidate: Candidate, states: States) -> bool:
    """Return whether a candidate effect is a function of the row number or of time."""
    return not clock_names(states.units).isdisjoint(candidate.inputs)


def _ratios(scores: Array, block: IntArray) -> Array:
    """Return Σ_blocks (Σ s)² / Σ s² for scores s of the poses (one column an effect). block: block of each pose."""
    together = np.zeros((int(block.max()) + 1, scores.shape[1]))
    np.add.at(together, block, scores)
    return np.asarray(np.sum(together**2, axis=0) / np.maximum(np.sum(scores**2, axis=0), 1e-300))


def _if_above(ratio: float, count: int) -> float:
    """Return a variance inflation over `count` blocks of poses, or 1 if the inflation is below 1 + 2 √(2/count)."""
    return ratio if ratio > 1.0 + 2.0 * np.sqrt(2.0 / count) else 1.0


def _among(residual: Residual, ratio: float, block: IntArray) -> float:
    """Shrink a variance inflation toward the mean inflation of the model's columns, as far as chance explains it.

    The result is m + (ratio - m) τ² / (τ² + c), with mean m and variance v of the inflation of the columns, variance c
    = 2 m²/blocks of an inflation under independence, and τ² = max(0, v - c). Without dependence all inflations are
    equal; with an instrument's drift a slowly varying column has a larger inflation. Source: Efron and Morris (1973).
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
    """Return the expected variance inflation for independent noise, if several poses place one body, such as a bar.

    The fit of the body removes a part of the residual e: Σ_blocks (|e|² - |Uᵀe|²) over its sum over poses, U a basis of
    the body's columns. The two ends of a bar have equal residuals, half of its length error: an inflation of two.
    explained: residual e of each row. placed: rows of U times e. pose, block: pose of a row, block of a pose.
    """
    whole = float(explained @ explained)
    taken = []
    for code in (block[pose], pose):
        sums = np.zeros((int(code.max()) + 1, placed.shape[1]))
        np.add.at(sums, code, placed)
        taken.append(float(np.sum(sums**2)))
    return max(whole - taken[0], 1e-300) / max(whole - taken[1], 1e-300)


def order_matters(residual: Residual, candidate: Candidate) -> bool:
    """Return whether dependence between rows would bias a cross-validation with random folds.

    The order matters if the rows are in the order of measurement, or if the candidate depends on the row number.
    """
    return residual.poses.states.past is not None or "row" in candidate.inputs


def _partitions(residual: Residual) -> Iterator[tuple[str, IntArray]]:
    """Yield the block of each pose for each kind of dependence: repeats, stretches of rows, regions of space."""
    count, poses = residual.criteria.blocks, len(residual.poses)
    if residual.block_of_pose.max() + 1 < poses:
        yield "repeats", residual.block_of_pose
    if poses >= 3 * count:
        yield "rows", stretches(residual.poses.states["row"], count)
        yield "space", regions(np.column_stack([residual.poses.states[axis] for axis in "xyz"]), count)


def regions(points: Array, count: int) -> IntArray:
    """Return the region index of each point; the largest region is repeatedly halved at its median."""
    region = np.zeros(len(points), dtype=np.int64)
    for new in range(1, count):
        own = np.flatnonzero(region == np.argmax(np.bincount(region)))
        axis = int(np.argmax(np.ptp(points[own], axis=0)))
        order = np.argsort(points[own, axis], kind="stable")
        region[own[order[len(own) // 2 :]]] = new
    return region
