"""Noise on two levels: an error that all repeats of a pose share, and an independent error of each measurement."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised

LARGEST_RATIO = 1e4
"""Largest ratio of the variance that repeats share to the variance within repeats. Beyond the limit, the difference of
repeats carries no information."""


@dataclass(frozen=True)
class Whitening:
    """Random-effects noise: the rows of a block share an error of variance ρ σ²; each row adds an error of variance σ².

    A block holds one component (such as x) of all repeats of a pose. The covariance of a block of n rows is σ² (I + ρ
    11ᵀ); a value v becomes v - (1 - 1/√(1 + n ρ)) mean(v), mean(v) over the block. block: index of the block of each
    row. ratio: variance ratio ρ of shared to independent noise.
    Source: Fuller and Battese (1973), transformation of the random-effects model.
    """

    block: IntArray
    ratio: float = 0.0

    def whiten(self, values: Array) -> Array:
        """Return whitened values: rows of equal variance, independent within a block of repeats."""
        return self._scaled(values, 1.0 / np.sqrt(1.0 + self.sizes * self.ratio))

    def unwhiten(self, values: Array) -> Array:
        """Return correlated values from whitened (independent) values."""
        return self._scaled(values, np.sqrt(1.0 + self.sizes * self.ratio))

    def _scaled(self, values: Array, factor: Array) -> Array:
        """Multiply the mean of each block of repeats by a factor; a single row is its own mean."""
        if self.ratio == 0.0:
            return values
        beside = [1] * (values.ndim - 1)
        out: Array = values * factor[self.block].reshape(-1, *beside)
        rows, numbers, again = self.shared
        several = values[rows]
        out[rows] = several + ((factor[numbers] - 1.0).reshape(-1, *beside) * again.means(several))[again.block]
        return out

    @cached_property
    def shared(self) -> tuple[IntArray, IntArray, "Whitening"]:
        """Rows of poses measured several times, block numbers of the rows, and the whitening of the rows."""
        rows = np.flatnonzero(self.sizes[self.block] > 1)
        numbers, block = np.unique(self.block[rows], return_inverse=True)
        return rows, numbers, replace(self, block=block.reshape(-1))

    @cached_property
    def sizes(self) -> IntArray:
        """Number of rows of each block of repeats."""
        return np.bincount(self.block)

    @cached_property
    def first(self) -> IntArray:
        """Number of the first row of each block of repeats."""
        return np.unique(self.block, return_index=True)[1]

    def means(self, values: Array) -> Array:
        """Return the mean of values over the rows of each block of repeats."""
        sizes = self.sizes
        count = len(self.block)
        if len(sizes) == count:
            return values[np.argsort(self.block)]
        belongs = sparse.csr_matrix((np.ones(count), (self.block, np.arange(count))), shape=(len(sizes), count))
        sums: Array = belongs @ values
        return sums / sizes.reshape(-1, *[1] * (values.ndim - 1))

    def estimated(self, residual: Array, unknowns: float) -> "Whitening":
        """Estimate the ratio ρ of shared to independent noise variance from the residual of a fit of `unknowns` values.

        ρ is max(0, B / W - 1) / n0, with the mean squares B between and W within blocks, and n0 rows in a typical
        block.
        """
        sizes = self.sizes
        inside = len(self.block) - len(sizes)
        if inside < 3:
            return self
        means = self.means(residual)
        within = float(np.sum((residual - means[self.block]) ** 2)) / inside
        between = float(np.sum(sizes * means**2)) / max(len(sizes) - unknowns, 1.0)
        typical = (len(self.block) - np.sum(sizes**2) / len(self.block)) / max(len(sizes) - 1, 1)
        ratio = max(0.0, between / max(within, 1e-300) - 1.0) / typical
        return replace(self, ratio=min(ratio, LARGEST_RATIO))


def decorrelate(problem: Linearised, values: Array, pose_id: IntArray, ratio: float) -> None:
    """Make the errors of repeated poses independent (whiten them), in place; a pose measured once is unchanged.

    pose_id: number of every pose, equal for repeats.
    ratio: variance shared by the repeats of a pose over the variance of one measurement.
    """
    if ratio > 0.0:
        rows, _, noise = blocks_of(problem, pose_id, ratio).shared
        values[rows] = np.sqrt(1.0 + ratio) * noise.whiten(values[rows])


def pose_ratio(problem: Linearised, pose_id: IntArray, ratio: float, held: float) -> float:
    """Estimate the variance shared by the repeats of a pose over the variance of one measurement, after a fit.

    problem: linear problem whose residual was whitened by `ratio`. pose_id: number of every pose, equal for repeats.
    held: number of fitted effects. If no pose was measured twice, the given `ratio` is returned.
    """
    noise = blocks_of(problem, pose_id, ratio)
    return noise.estimated(noise.unwhiten(problem.residual) / np.sqrt(1.0 + ratio), problem.placement + held).ratio


def freedom(problem: Linearised, pose_id: IntArray, ratio: float, rank: float) -> float:
    """Return the degrees of freedom of the residual variance about a model of effectively `rank` unknowns.

    For M independent measurements the degrees of freedom are M - rank. For B blocks of n measurements with variance
    ratio ρ, Satterthwaite's formula holds for the sum of shared and independent variance: 2 (1 + ρ)² / V with V = (2 (1
    + n ρ)² / (B - rank) + 2 (n - 1)² / (M - B)) / n². Source: JCGM 100 (2008), G.4.
    """
    count, blocks = len(problem.residual), len(blocks_of(problem, pose_id).sizes)
    if ratio == 0.0 or blocks == count:
        return float(max(count - rank, 1))
    size = count / blocks
    variance = 2 * (1 + size * ratio) ** 2 / max(blocks - rank, 1) + 2 * (size - 1) ** 2 / (count - blocks)
    return 2 * (1 + ratio) ** 2 * size**2 / variance


def blocks_of(problem: Linearised, pose_id: IntArray, ratio: float = 0.0) -> Whitening:
    """Return the whitening of repeated measurements, whose blocks hold one component of one pose, for a known ratio.

    pose_id: number of every pose, equal for repeats. With unmeasured joints every row is a block of its own, since
    elimination of joint values mixes the components.
    """
    if problem.reduced is not None:
        return Whitening(np.arange(len(problem.residual)), ratio)
    component = np.nonzero(problem.weights > 0)[1]
    key = pose_id[problem.pose_of_row] * problem.weights.shape[1] + component
    return Whitening(np.unique(key, return_inverse=True)[1].reshape(-1).astype(np.int64), ratio)
