"""Test that `compensate` states the standard deviation that `predict` states, and that the true error agrees."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from torso_cases import TIPS, torso

import gpmodel as gp
from gpmodel.application.compensate import GIVEN, compensate, joint_targets
from gpmodel.application.predict import predicted_columns
from gpmodel.application.usable import at_end, usable
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import observe, prepare
from gpmodel.planning.simulate import simulate

SEEDS = 3


def mechanism(name: str, folder: Path) -> Mechanism:
    if name != "torso":
        return gp.load_mechanism(name)
    (folder / "torso.urdf").write_text(torso())
    return gp.load_mechanism(str(folder / "torso.urdf"), frame=TIPS)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    "name", ["irb6400r", "hexapod", *(pytest.param(name, marks=pytest.mark.long) for name in ("tau", "torso"))]
)
def test_a_compensated_target_is_as_certain_as_a_prediction(name: str, tmp_path: Path) -> None:
    """The target is given in the frame of the root, whose place is the fitted registration."""
    arm, stated, true = mechanism(name, tmp_path), [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        made = simulate(arm, random_poses(arm, 100, rng), rng=rng, effects=(), noise=2e-5, geometry_sigma=3e-4)
        fitted, new = made.dataset.subset(np.arange(80)), made.dataset.subset(np.arange(80, 100))
        saved = at_end(usable(gp.calibrate(arm, fitted, holdout=0.0).model.saved))
        blank = np.full_like(new.position, np.nan)
        targets = joint_targets(saved, replace(new, q=0.8 * new.q + 0.2 * made.dataset.q.mean(axis=0), position=blank))
        found = compensate(saved, targets)
        given = np.isin(found.status, GIVEN)
        went = replace(targets.dataset.subset(np.flatnonzero(given)), q=found.q[given])
        sigma = predicted_columns(saved, went)["sigma [mm]"].astype(float)
        np.testing.assert_allclose(1e3 * found.sigma[given], sigma, rtol=1e-6)
        reached = observe(made.model, prepare(arm, went), made.theta, made.placement).tip[:, :3, 3]
        wanted = (saved.placement.roots(went) @ targets.frames[given])[:, :3, 3]
        stated.append(np.mean(found.sigma[given] ** 2))
        true.append(np.mean(np.sum((reached - wanted) ** 2, axis=1)))
        assert given.sum() >= 10
    assert 0.5 < np.sqrt(np.mean(true) / np.mean(stated)) < 1.6
