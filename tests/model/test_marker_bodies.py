"""Markers around a body, of which a camera sees some at a time; pixels beside lengths."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from instrument_cases import ARM, simulated, tool_error
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.weigh import weighed
from gpmodel.model.camera_start import view_pose
from gpmodel.model.error_model import ErrorModel, measured_minus, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.se3 import frame_of

BALL = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]) * 0.04
SIDEWAYS = np.cos(np.radians(70.0))
"""Markers turned farther from the camera are not found."""


@pytest.mark.long
def test_a_body_is_placed_by_the_markers_that_are_seen_and_a_wrong_one_does_no_harm() -> None:
    rng = np.random.default_rng(1)
    for k in range(20):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=k).as_matrix(), [0.1, -0.2, 1.5]
        points = BALL @ pose[:3, :3].T + pose[:3, 3]
        seen = points[:, :2] / points[:, 2:]
        np.testing.assert_allclose(view_pose(BALL, seen, None), pose, atol=1e-6)
        wrong = seen.copy()
        wrong[rng.integers(len(seen))] += 0.02
        np.testing.assert_allclose(view_pose(BALL, wrong, None), pose, atol=0.02)


@pytest.mark.long
def test_a_camera_that_sees_a_few_markers_of_a_body_calibrates_the_arm() -> None:
    made = simulated("camera", 60)
    saved, mechanism = made.truth.saved, made.truth.mechanism
    points = {str(k): [*map(float, 1e3 * at)] for k, at in enumerate(BALL)}
    board = {"board": {"B": {"link": "tool", "points_mm": points}}}
    rows = np.arange(0, len(made.table), 20)
    data = made.table.subset(np.repeat(rows, len(BALL)))
    marker = np.tile(np.arange(len(BALL)).astype(str), len(rows))
    data = replace(data, row=np.arange(1, len(data) + 1), labels={**data.labels, "marker": marker})
    data = with_observations(data, mechanism, {**made.table.described, "board": board})
    poses = prepare(mechanism, data)
    there = observe(saved.model, poses, saved.theta, saved.placement)
    read = data.observations[0].values - measured_minus(there, data)[:, 6:]
    held = there.tips.slots[-1] @ frame_of(there.own["board B"])
    faces = (held[:, :3, :3] @ np.tile(BALL, (len(rows), 1))[:, :, None])[:, :, 0]
    sight = frame_of(there.own["camera C"])[:3, 3] - held[:, :3, 3]
    towards = np.sum(faces * sight, axis=1) / np.linalg.norm(faces, axis=1) / np.linalg.norm(sight, axis=1)
    read += np.random.default_rng(0).normal(0.0, 0.1, read.shape)
    shown = data.subset(np.flatnonzero(towards > SIDEWAYS))
    kept = np.flatnonzero(towards > SIDEWAYS)
    shown = with_observations(replace(shown, readings=dict(zip("uv", read[kept].T, strict=True))), mechanism)
    assert np.unique(shown.q, axis=0, return_counts=True)[1].min() < len(BALL) / 2
    poses = weighed(mechanism, prepare(mechanism, shown))
    fit = calibrate(ErrorModel(mechanism, geometric_effects(mechanism)), poses)
    assert fit.status == "converged"
    left = measured_minus(observe(fit.model, poses, fit.theta, fit.placement), shown)[:, 6:]
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.1, rel=0.05)
    bare = calibrate(ErrorModel(mechanism, ()), poses)
    assert np.linalg.norm(tool_error(made, fit)) < 0.4 * np.linalg.norm(tool_error(made, bare))


@pytest.mark.long
def test_pixels_beside_bars_weigh_by_their_own_noise() -> None:
    parts = [gp.simulate(ARM, poses=40, instrument=name, seed=3) for name in ("bar", "camera")]
    frame = pd.concat([made.to_dataframe() for made in parts], ignore_index=True)
    data = with_observations(gp.read_table(frame, ARM, **parts[1].table.described), parts[1].truth.mechanism)
    poses = weighed(parts[1].truth.mechanism, prepare(parts[1].truth.mechanism, data))
    metres = {kind.name: kind.metres for kind in poses.dataset.observations}
    assert 0.6 < metres["pixel"] / (0.03e-3 / 0.1) < 1.6
