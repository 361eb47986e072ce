"""Pose accuracy where poses were measured again and again, of poses left out as of poses fitted."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import measure

from gpmodel.calibration.comparison import climb, growing
from gpmodel.model.error_model import prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.report.iso9283 import positioning

NOISE, TIMES = 2e-5, 4


def test_pose_accuracy_is_as_good_of_poses_held_out_as_of_poses_fitted() -> None:
    """Each mean of four readings is off by its noise and by what the fit does not know."""
    plain = measure("ur5", (), (), 1, count=80, noise=0.0)
    again = plain.poses.dataset.subset(np.repeat(np.arange(80), TIMES))
    rng = np.random.default_rng(0)
    data = replace(
        again, position=again.position + NOISE * rng.normal(size=again.position.shape), row=np.arange(80 * TIMES),
        labels={"repeat": np.array([f"p{k // TIMES}" for k in range(80 * TIMES)])},
    )  # fmt: skip
    poses = prepare(plain.model.mechanism, data)
    train = np.arange(50 * TIMES)
    models = growing(geometric_effects(plain.model.mechanism), ())
    steps = climb(plain.model.mechanism, models, poses.subset(train), poses.subset(np.arange(50 * TIMES, 80 * TIMES)))
    held = positioning(poses, train, steps)
    fitted = positioning(poses.subset(train), train, steps)
    assert held is not None
    assert fitted is not None
    assert (held.poses, held.heldout, fitted.poses, fitted.heldout) == (30, True, 50, False)
    assert fitted.after_mm == pytest.approx(
        held.after_mm, abs=3 * np.hypot(held.after_stderr_mm, fitted.after_stderr_mm)
    )
    assert 0.7 < held.after_mm / (1e3 * NOISE * np.sqrt(8 / np.pi / TIMES)) < 1.7
    assert held.before_mm > 10 * held.after_mm
    assert held.after_max_mm > held.after_mm


def test_it_is_not_stated_where_nothing_was_measured_three_times() -> None:
    truth = measure("ur5", (), (), 1, count=60)
    steps = climb(truth.model.mechanism, growing((), ()), truth.poses, truth.poses)
    assert positioning(truth.poses, np.arange(60), steps) is None
