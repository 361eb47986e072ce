"""Test that a later session is judged with noise of positions that depends on the direction."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import measure
from instances import some

import gpmodel as gp
from gpmodel.table.dataset import Dataset

CASES = [(arm, along, seed) for arm in ("irb6400r", "ur5", "gantry") for along in (4.0, 10.0) for seed in range(16)]
SHORT = ("irb6400r", 10.0, 2), ("ur5", 10.0, 15)


@cache
def measured(arm: str, along: float, seed: int) -> tuple[gp.Model, Dataset]:
    """A model of 60 poses, and 20 or 40 later poses, measured with noise that is larger along z."""
    count = 60 + (40 if arm == "ur5" else 20)
    truth = measure(arm, (), (), seed, count=count, noise=0.0)
    noise = np.random.default_rng([seed, 7]).normal(size=(count, 3)) * [1e-5, 1e-5, along * 1e-5]
    data = replace(truth.poses.dataset, position=truth.poses.dataset.position + noise)
    fitted, later = data.subset(np.arange(60)), data.subset(np.arange(60, count))
    return gp.calibrate(truth.model.mechanism, fitted, holdout=0.0).model, replace(later, source="later.csv")


@pytest.mark.parametrize(("arm", "along", "seed"), some(CASES, *SHORT))
def test_an_unchanged_machine_holds(arm: str, along: float, seed: int) -> None:
    model, later = measured(arm, along, seed)
    assert model.verify(later).record.verdict == "holds"


@pytest.mark.parametrize(("arm", "along", "seed"), some(CASES[:64], *SHORT))
def test_a_moved_zero_is_named(arm: str, along: float, seed: int) -> None:
    model, later = measured(arm, along, seed)
    q = later.q.copy()
    q[:, 1] += 5e-4
    found = model.verify(replace(later, q=q)).record
    assert found.verdict == "drifted"
    named = found.changes[0]
    assert f"zero of {model.mechanism.joints[1].name}" in (named.name, *named.rivals)
