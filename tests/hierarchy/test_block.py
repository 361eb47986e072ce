"""Test effects with priors that several machines share, on simulated numbers."""

import numpy as np
import pytest
from scipy import stats

from gpmodel.hierarchy.between import deviations
from gpmodel.hierarchy.block import BlockInformation, type_distribution
from gpmodel.numerics.interval import SIGNIFICANCE

FLEETS, MACHINES, EFFECTS = 20, 8, 6


def drawn(seed: int, spread: float, differing: int = EFFECTS, odd: int | None = None) -> BlockInformation:
    """Machines with a mean of the priors' size, of which the first `differing` effects spread; poses tell some
    directions ten times, some not better than the prior does."""
    rng = np.random.default_rng(seed)
    mean = rng.normal(size=EFFECTS)
    size = spread * np.sqrt(EFFECTS / differing) * (np.arange(EFFECTS) < differing)
    roots, values = [], []
    for machine in range(MACHINES):
        turn = np.linalg.qr(rng.normal(size=(EFFECTS, EFFECTS)))[0]
        information = np.where(rng.random(EFFECTS) < 0.8, rng.uniform(30.0, 300.0, EFFECTS), 0.0)
        information[0] = 100.0
        own = mean + size * rng.normal(size=EFFECTS) + (2.0 if machine == odd else 0.0)
        root = np.sqrt(information)[:, None] * turn.T
        roots.append(root)
        values.append(root @ own + (information > 0) * rng.normal(size=EFFECTS))
    root = np.array(roots)
    return BlockInformation(np.array(values), root, root.any(axis=2).sum(axis=1))


@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_the_spread_is_covered_as_often_as_it_says(spread: float) -> None:
    found = [type_distribution(drawn(seed, spread)) for seed in range(FLEETS)]
    inside = sum(of.low <= spread <= of.high for of in found)
    assert stats.binomtest(inside, FLEETS, 0.95, alternative="less").pvalue > 0.001
    assert np.sqrt(np.mean([of.spread**2 for of in found])) == pytest.approx(spread, rel=0.2, abs=0.05)


@pytest.mark.first(2)
@pytest.mark.parametrize("differing", [1, EFFECTS])
@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_innocent_machines_stand_out_no_more_often_than_stated(spread: float, differing: int) -> None:
    found = [deviations([drawn(k, spread, differing)], MACHINES) for k in range(2 * FLEETS)]
    false = sum(not of.inside.all() for of in found)
    assert stats.binomtest(false, len(found), SIGNIFICANCE, alternative="greater").pvalue > 0.001


def test_a_planted_machine_is_found() -> None:
    found = deviations([drawn(0, 0.1, odd=5)], MACHINES)
    assert np.flatnonzero(~found.inside[:, 0]).tolist() == [5]
