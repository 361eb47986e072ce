"""Test instruments that measure no positions: columns, calibration and refusals."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from instrument_cases import ARM, OTHERS, ready, simulated, tool_error
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.start import placement_after
from gpmodel.calibration.unobservable import unobservable_sentences
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, measured_minus, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.model.pixel import view_pose
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.rank import orthonormal, remove
from gpmodel.numerics.se3 import frame_of
from gpmodel.table.dataset import Dataset

STEP = 2e-6
SIZELESS = ("planes", "spheres", "points")


@pytest.mark.long
@pytest.mark.parametrize("instrument", OTHERS)
def test_columns_are_the_derivatives_of_the_readings(instrument: str) -> None:
    """Bars follow their touches: both are compared less what a bar's own place takes up."""
    made = simulated(instrument, 18)
    poses, saved = ready(made), made.truth.saved
    effects = geometric_effects(saved.mechanism)
    model, theta = ErrorModel(saved.mechanism, effects), np.array(saved.theta[: len(effects)])
    there = observe(model, poses, theta, saved.placement)
    placement = replace(saved.placement, anchors=there.own)
    problem = linearise(model, poses, theta, placement, Weighting({}, np.ones(len(poses), dtype=bool)))
    scale = problem.weights[problem.weights > 0]
    own = orthonormal(problem.columns[:, [k for k, n in enumerate(problem.placement_names) if n.startswith("pair")]])
    for k in range(problem.columns.shape[1]):
        step, moved = np.zeros(problem.columns.shape[1]), []
        for side in (1, -1):
            step[k] = side * STEP
            near = placement_after(problem.observed, placement, step[: problem.placement])
            seen = observe(model, poses, theta + step[problem.placement :], near)
            moved.append(measured_minus(seen, poses.dataset)[problem.weights > 0] * scale)
        numeric, column = (moved[1] - moved[0]) / (2 * STEP), problem.columns[:, k]
        if instrument == "bar":
            numeric, column = (remove(own, values[:, None])[:, 0] for values in (numeric, column))
        np.testing.assert_allclose(column, numeric, atol=1e-6 * max(np.abs(numeric).max(), 1e-3))


@pytest.mark.long
@pytest.mark.parametrize("instrument", OTHERS)
def test_it_calibrates_from_a_start_of_its_own(instrument: str) -> None:
    made = simulated(instrument, 160)
    poses = ready(made)
    bare = calibrate(ErrorModel(made.truth.mechanism, ()), poses)
    fit = calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), poses)
    assert fit.status == "converged"
    if instrument != "inclinometer":
        before, after = (np.sqrt(np.mean(tool_error(made, f) ** 2)) for f in (bare, fit))
        assert after < (1.0 if instrument in SIZELESS else 0.25) * before
        assert after < (1.0e-3 if instrument in SIZELESS else 0.15e-3)


@pytest.mark.long
def test_size_that_nothing_shows_stays_as_described_and_is_named() -> None:
    made = simulated("points", 160)
    fit = calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), ready(made))
    assert np.sqrt(np.mean(tool_error(made, fit) ** 2)) < 0.5e-3
    said = " ".join(unobservable_sentences(made.table.observations))
    assert "the measurements (same_point) do not determine the scale" in said
    assert "larger" not in " ".join(unobservable_sentences(simulated("bar", 160).table.observations))


@pytest.mark.long
def test_one_length_that_is_off_does_not_say_how_large_a_machine_is() -> None:
    made = gp.simulate(ARM, ["J3.moving:Tx:1=1 mm"], poses=120, instrument="points", noise="0.01 mm")
    fit = calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), ready(made))
    off = np.sqrt(np.mean(tool_error(made, fit) ** 2))
    assert off < 0.5e-3
    assert np.nanmax(fit.stderr[[e.unit == "m" for e in fit.model.effects]]) > 0.3 * off


@pytest.mark.long
def test_a_tool_that_nothing_shows_has_no_number() -> None:
    shown = {name: gp.calibrate(ARM, simulated(name, 60).table).record.placement for name in ("camera", "tracker")}
    assert [number.name for number in shown["camera"]] == []
    assert [n.name for n in shown["tracker"]][:3] == ["tool x", "tool y", "tool z"]


@pytest.mark.long
def test_a_lens_that_nobody_knows_is_found_with_the_rest() -> None:
    made = simulated("camera", 60)
    known = made.table.described["cameras"]["camera"]["C"]
    cameras = {"camera": {"C": {"link": known["link"]}}}
    data = with_observations(made.table, made.truth.mechanism, {**made.table.described, "cameras": cameras})
    fit = gp.calibrate(ARM, data).calibrated.final
    lens = fit.placement.anchors["lens C"]
    np.testing.assert_allclose(lens[:4], [*known["focal_px"], *known["centre_px"]], rtol=3e-3)
    assert fit.status == "converged"


@pytest.mark.long
def test_wrong_corners_are_found_by_row() -> None:
    made = simulated("camera", 60)
    rng = np.random.default_rng(3)
    wrong = np.sort(rng.choice(len(made.table), len(made.table) // 20, replace=False))
    u = made.table.readings["u"].copy()
    u[wrong] += rng.choice([-1, 1], len(wrong)) * rng.uniform(4.0, 40.0, len(wrong))
    data = replace(made.table, readings={**made.table.readings, "u": u})
    data = with_observations(data, made.truth.mechanism)
    fit = gp.calibrate(ARM, data).calibrated.final
    assert set(wrong) <= set(fit.outliers.tolist())
    assert len(fit.outliers) <= 1.2 * len(wrong)


@pytest.mark.long
def test_a_probe_that_slipped_is_found_by_row() -> None:
    made = simulated("planes", 160)
    q = made.table.q.copy()
    q[17, 1] += 2e-3
    data = with_observations(replace(made.table, q=q), made.truth.mechanism)
    assert 17 in gp.calibrate(ARM, data).calibrated.final.outliers


@pytest.mark.long
def test_one_table_holds_several_kinds() -> None:
    parts = []
    for name in ("tracker", "planes", "points", "inclinometer"):
        made = gp.simulate(ARM, poses=40, instrument=name, seed=3)
        parts.append(made.to_dataframe().assign(tool=name))
    result = gp.calibrate(ARM, pd.concat(parts, ignore_index=True))
    shown = {r.name: r for r in result.record.readings}
    assert set(shown) == {"position", "on_plane", "same_point", "inclination"}
    assert shown["position"].after == pytest.approx(0.03, rel=0.4)
    assert shown["inclination"].after == pytest.approx(0.002, rel=0.4)
    assert "inclination" in result.summary()
    assert result.record.unseen == ()


def few_corners(data: Dataset) -> Dataset:
    return data.subset(np.setdiff1d(np.arange(len(data)), np.arange(3, 20)))


def unknown_camera(data: Dataset) -> Dataset:
    names = data.label("camera").copy()
    names[4] = "D"
    return replace(data, labels={**data.labels, "camera": names})


def lonely(data: Dataset) -> Dataset:
    names = data.label("same_point").copy().astype("<U8")
    names[5] = "alone"
    return replace(data, labels={"same_point": names})


@pytest.mark.long
@pytest.mark.parametrize(
    ("instrument", "spoil", "said"),
    [
        ("camera", few_corners, "row 1: camera 'C' sees 3 corners in one pose; expected at least 4"),
        ("camera", unknown_camera, "row 5: camera 'D' is unknown; expected C"),
        ("points", lonely, "column 'same_point', row 6: 'alone' has one touch; expected at least 2"),
        ("bar", lambda d: d.subset(np.arange(1, len(d))), "'B0' has 1 rows; expected two, the ends of one bar"),
    ],
)
def test_what_it_refuses(instrument: str, spoil, said: str) -> None:  # type: ignore[no-untyped-def]
    made = simulated(instrument, 60)
    with pytest.raises(InputError, match=said):
        with_observations(spoil(made.table), made.truth.mechanism)


def test_a_plane_touched_along_a_line_is_refused() -> None:
    made = simulated("planes", 60)
    q = made.table.q.copy()
    q[::3] = q[0] + np.linspace(0, 1e-3, len(q[::3]))[:, None] * np.eye(6)[0]
    data = with_observations(replace(made.table, q=q), made.truth.mechanism)
    with pytest.raises(InputError, match="on_plane A: touched along a line; expected touches spread over the plane"):
        gp.calibrate(ARM, data)


@pytest.mark.long
def test_a_centre_that_is_not_the_images_is_the_cause_that_check_names() -> None:
    """As of an image that was turned upright: 950 px."""
    made = simulated("camera", 40)
    known = made.table.described["cameras"]["camera"]["C"]
    x, y = known["centre_px"]
    wrong = {"camera": {"C": {**known, "centre_px": [x - 950.0, y]}}}
    data = with_observations(made.table, made.truth.mechanism, {**made.table.described, "cameras": wrong})
    said = [f.text for f in gp.check(ARM, data).findings if "the lens of a camera is not the described one" in f.text]
    assert len(said) == 1
    assert f"described as {x - 950:.4g}" in said[0]


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
    poses = prepare(mechanism, shown)
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
    arm = parts[1].truth.mechanism
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), prepare(arm, data))
    assert 0.6 < fit.weights["pixel"] / fit.weights["pair"] / (0.03e-3 / 0.1) < 1.6


@pytest.mark.long
def test_exchanged_coordinates_of_an_image_are_named() -> None:
    made = simulated("camera", 40)
    turned = {"u": made.table.readings["v"], "v": made.table.readings["u"]}
    data = replace(made.table, readings={**made.table.readings, **turned})
    with pytest.raises(gp.InputError, match="u and v look exchanged"):
        gp.calibrate(ARM, with_observations(data, made.truth.mechanism, made.table.described))


@pytest.mark.long
def test_another_pitch_of_a_board_is_a_possible_cause_of_a_large_residual() -> None:
    made = simulated("camera", 40)
    known = made.table.described["board"]["board"]["B"]
    board = {"board": {"B": {**known, "pitch_mm": 1.25 * known["pitch_mm"]}}}
    data = with_observations(made.table, made.truth.mechanism, {**made.table.described, "board": board})
    said = [f.text for f in gp.check(ARM, data).findings]
    assert any("another pitch or size of the board" in text for text in said), said
