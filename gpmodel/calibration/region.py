"""The region of a table: the ball that holds nine in ten of its points; and random poses inside and outside of it."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.table.dataset import Dataset

HELD = 0.9
"""Share of the measured points in the ball: single far ones make no region."""
DRAWN = 400
"""Random poses at which the error inside and outside the region is averaged."""


@dataclass(frozen=True)
class Region:
    """A ball about the median of points: middle (3,) and radius, m."""

    middle: Array
    radius: float

    @classmethod
    def of(cls, points: Array) -> "Region":
        """The ball that holds HELD of some points (N, 3), m."""
        middle = np.median(points, axis=0)
        return cls(middle, float(np.quantile(np.linalg.norm(points - middle, axis=1), HELD)))

    def holds(self, points: Array) -> Mask:
        """Return which of some points (N, 3), m, are inside."""
        return np.asarray(np.linalg.norm(points - self.middle, axis=1) <= self.radius)


def anywhere(mechanism: Mechanism, dataset: Dataset) -> Dataset:
    """DRAWN random rows of a table, without its readings, at random joint values within the limits."""
    rng = np.random.default_rng(0)
    rows = rng.integers(len(dataset), size=DRAWN)
    bare = replace(dataset, observations=(), in_order=False).subset(rows)
    return replace(bare, q=random_poses(mechanism, DRAWN, rng))


def nominal_points(mechanism: Mechanism, poses: Poses) -> Array:
    """Where each row's tip is (N, 3), m, in the root, by the description and without a tool."""
    frames = ErrorModel(mechanism, ()).frames(poses, np.zeros(0))
    return np.asarray(frames[poses.tip_slot, np.arange(len(poses)), :3, 3])
