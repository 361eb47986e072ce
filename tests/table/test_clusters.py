"""Poses measured in clusters of neighbours are recognised without a label, and nothing else is taken for clusters."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare

from gpmodel.arrays import Array
from gpmodel.table.bundles import bundles, replicates, sharing
from gpmodel.table.dataset import Dataset
from gpmodel.table.split import hold_out

RNG = np.random.default_rng(3)
LOW, HIGH = np.full(6, -2.0), np.full(6, 1.5)


def table(q: Array) -> Dataset:
    return replace(bare("irb6400r", len(q), 3, payload=False), q=q)


def clusters(count: int, size: int, half: float) -> Array:
    """Boxes of a half-width as a share of the range, in no order of their rows."""
    centres = np.repeat(RNG.uniform(LOW, HIGH, (count, 6)), size, axis=0)
    return RNG.permutation(centres + half * (HIGH - LOW) * RNG.uniform(-1, 1, centres.shape))


@pytest.mark.parametrize(("count", "size", "half"), [(12, 10, 0.02), (30, 5, 0.01), (40, 2, 0.005), (8, 20, 0.01)])
def test_clusters_are_bundles_that_no_split_parts(count: int, size: int, half: float) -> None:
    data = table(clusters(count, size, half))
    assert np.bincount(bundles(data)).tolist() == [size] * count
    assert len(np.unique(sharing(data))) == count
    assert len(np.unique(replicates(data))) == len(data)
    train, heldout = hold_out(data, 0.3, np.random.default_rng(0))
    assert not set(bundles(data)[train]) & set(bundles(data)[heldout])


@pytest.mark.parametrize("gap", [0.05, 0.1, 0.15])
def test_two_clusters_that_lie_close_leave_the_others_what_they_are(gap: float) -> None:
    q = clusters(20, 10, 0.02)
    centre = RNG.uniform(LOW, HIGH, 6)
    box = 0.02 * (HIGH - LOW) * RNG.uniform(-1, 1, (2, 10, 6))
    beside = centre + np.array([[[0.0]], [[gap]]]) * (HIGH - LOW) + box
    sizes = np.bincount(bundles(table(np.vstack([q, *beside]))))
    assert sorted(sizes.tolist()) in ([10] * 22, [10] * 20 + [20])


def sweeps() -> Array:
    """Each joint alone through its range at eight places."""
    return np.vstack(
        [
            np.tile(c, (20, 1)) + np.outer(np.linspace(-1, 1, 20), np.eye(6)[k % 6])
            for k, c in enumerate(RNG.uniform(LOW, HIGH, (8, 6)))
        ]
    )


SCATTERED = {
    "random": RNG.uniform(LOW, HIGH, (80, 6)),
    "few": RNG.uniform(LOW, HIGH, (20, 6)),
    "two joints": RNG.uniform(LOW, HIGH, (90, 6)) * np.array([0, 1, 1, 0, 0, 0]),
    "a walk": np.cumsum(0.1 * RNG.normal(size=(120, 6)), axis=0),
    "a grid": np.stack(np.meshgrid(*[np.linspace(-1, 1, 4)] * 3, [0.0], [0.0], [0.0]), axis=-1).reshape(-1, 6),
    "sweeps": sweeps(),
    "repeats": np.repeat(RNG.uniform(LOW, HIGH, (40, 6)), 3, axis=0) + 1e-5 * RNG.normal(size=(120, 6)),
    "one box": 0.02 * RNG.uniform(LOW, HIGH, (60, 6)),
}


@pytest.mark.parametrize("how", SCATTERED)
def test_other_poses_are_not(how: str) -> None:
    data = table(SCATTERED[how])
    np.testing.assert_array_equal(sharing(data), replicates(data))


def test_a_pose_measured_with_several_payloads_shares_what_no_model_explains() -> None:
    """Each payload is read anew, and whatever the pose has in common is common to all."""
    data = replace(table(SCATTERED["repeats"]), payload=np.tile([0.0, 2.0, 6.0], 40))
    assert len(np.unique(replicates(data))) == 120
    np.testing.assert_array_equal(sharing(data), np.repeat(sharing(data)[::3], 3))
    assert len(np.unique(sharing(data))) == 40
