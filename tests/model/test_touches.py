"""Test touches of a known artefact, lines, spheres of known diameter, and several cameras."""

from dataclasses import replace

import numpy as np
import pytest
from instrument_cases import ARM, ready, simulated, tool_error

import gpmodel as gp
from gpmodel.api.simulate import SimulationResult
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, Poses, measured_minus, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import frame_of, numbers_of
from gpmodel.planning.simulate import BALL, TrueMechanism, read_in, scene_of
from gpmodel.table.dataset import Dataset

NOISE = 3e-5
CORNER = {"plane": {"A": {"normal": [1, 0, 0]}, "B": {"normal": [0, 1, 0]}, "C": {"normal": [0, 0, 1]}}}
"""Three faces of a cube, as the simulated planes stand to each other."""


def fitted(made: SimulationResult, data: Dataset) -> tuple[Calibration, Poses]:
    poses = prepare(made.truth.mechanism, data)
    return calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), poses), poses


def left(fit: Calibration, poses: Poses) -> float:
    """Root mean square of what is left of one reading, m."""
    residual = measured_minus(observe(fit.model, poses, fit.theta, fit.placement), poses.dataset)
    return float(np.sqrt(np.nanmean(residual**2)))


def described(made: SimulationResult, surfaces: dict[str, object]) -> Dataset:
    return with_observations(made.table, made.truth.mechanism, {"surfaces": surfaces})


@pytest.mark.long
def test_planes_of_one_artefact_have_one_pose() -> None:
    made = simulated("planes", 90)
    data = described(made, CORNER)
    assert [o.name for o in data.observations] == ["surfaces"]
    assert [len(names) for o in data.observations for names in o.own.values()] == [6]
    fit, poses = fitted(made, data)
    assert fit.status == "converged"
    assert left(fit, poses) < 1.1 * NOISE
    assert np.sqrt(np.mean(tool_error(made, fit) ** 2)) < 1e-3
    skewed = {"plane": {**CORNER["plane"], "C": {"normal": [0.05, 0, 1]}}}
    assert left(*fitted(made, described(made, skewed))) > 1.5 * left(fit, poses)


@pytest.mark.long
def test_a_probe_of_known_diameter_moves_the_faces_out() -> None:
    made = simulated("planes", 90)
    plain, probed = described(made, CORNER), described(made, {"probe_diameter_mm": 10.0, **CORNER})
    poses = [prepare(made.truth.mechanism, data) for data in (plain, probed)]
    model = ErrorModel(made.truth.mechanism, ())
    corners = [calibrate(model, p).placement.anchors["surfaces"][:3] for p in poses]
    assert np.linalg.norm(corners[0] - corners[1]) == pytest.approx(5e-3 * np.sqrt(3), rel=0.05)


@pytest.mark.long
def test_spheres_of_known_diameter_lose_their_radius_as_an_unknown() -> None:
    made = simulated("spheres", 90)
    sizes = {name: {"diameter_mm": 2e3 * BALL} for name in "ABC"}
    data = described(made, {"sphere": sizes})
    free = [len(names) for o in made.table.observations for names in o.own.values()]
    known = [len(names) for o in data.observations for names in o.own.values()]
    assert (free, known) == ([4, 4, 4], [3, 3, 3])
    fit, poses = fitted(made, data)
    assert left(fit, poses) < 1.1 * NOISE
    wrong = {name: {"diameter_mm": 2e3 * BALL + 4.0} for name in "ABC"}
    assert left(*fitted(made, described(made, {"sphere": wrong}))) > 3 * left(fit, poses)


@pytest.mark.parametrize(
    ("surfaces", "said"),
    [
        ({"plane": {"A": {"offset_mm": 1.0}}}, "normal"),
        ({"sphere": {"A": {"centre_mm": [0, 0, 0]}}}, "expected diameter_mm with centre_mm"),
        ({"cone": {"A": {}}}, "cone"),
    ],
)
def test_a_description_of_surfaces_that_cannot_be_is_one_line(surfaces: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        described(simulated("planes", 60), surfaces)


def touched_lines(count: int = 90) -> tuple[SimulationResult, Dataset]:
    """Three lines, each touched along its length."""
    made, rng = simulated("planes", 60), np.random.default_rng(4)
    saved = made.truth.saved
    real = TrueMechanism(saved.model, saved.theta, saved.placement)
    pool = rng.uniform(-1.0, 1.0, (20 * count, 6)) * 0.9
    scene = scene_of("planes", saved.mechanism, pool, count, saved.placement.tool[""][:3, 3], rng)
    which, along = np.arange(count) % 3, np.eye(3)
    middle = np.median(scene.points[0], axis=0)

    def straight(p: Array) -> Array:
        through = middle + 0.2 * np.roll(along, 1, axis=0)[which]
        return through + np.sum((p - through) * along[which], axis=1, keepdims=True) * along[which]

    labels = {"on_line": np.array(["K", "L", "M"])[which]}
    empty = made.table.subset(np.zeros(count, dtype=np.int64))
    empty = replace(empty, row=np.arange(1, count + 1), labels={}, observations=())
    return made, read_in(replace(scene, labels=labels, aims=straight), real, empty, NOISE, rng)[0]


def test_lines_calibrate_and_their_two_gaps_are_read() -> None:
    made, data = touched_lines()
    (lines,) = data.observations
    assert (lines.name, lines.components) == ("on_line", 2)
    fit, poses = fitted(made, data)
    assert fit.status == "converged"
    assert left(fit, poses) < 1.1 * NOISE
    bare = calibrate(ErrorModel(made.truth.mechanism, ()), poses)
    assert left(bare, poses) > 5 * left(fit, poses)


@pytest.mark.long
def test_two_cameras_see_one_board_and_both_are_placed() -> None:
    made = simulated("camera", 16)
    saved, mechanism = made.truth.saved, made.truth.mechanism
    anchors = dict(saved.placement.anchors)
    beside = numbers_of(
        se3.exp(np.concatenate([[0.05, -0.03, 0.02], [0.01, 0.02, 0.0]])) @ frame_of(anchors["camera C"])
    )
    one, count = made.table, len(made.table)
    both = one.subset(np.tile(np.arange(count), 2))
    names = np.repeat(["C", "D"], count)
    lens = one.described["cameras"]["camera"]["C"]
    cameras = {"cameras": {"camera": {"C": lens, "D": lens}}, "board": one.described["board"]}
    both = replace(both, row=np.arange(1, 2 * count + 1), labels={**both.labels, "camera": names}, described=cameras)
    both = with_observations(both, mechanism)
    there = replace(saved.placement, anchors={**anchors, "camera D": beside})
    observed = observe(saved.model, prepare(mechanism, both), saved.theta, there)
    exact = -measured_minus(observed, both)[count:, 6:] + np.column_stack([both.readings[c] for c in "uv"])[count:]
    noisy = exact + 0.1 * np.random.default_rng(8).normal(size=exact.shape)
    readings = {c: np.concatenate([one.readings[c], noisy[:, i]]) for i, c in enumerate("uv")}
    both = with_observations(replace(both, readings=readings), mechanism)
    fit = gp.calibrate(ARM, both).calibrated.final
    assert fit.status == "converged"
    found = [frame_of(fit.placement.anchors[f"camera {name}"]) for name in "CD"]
    between, true = np.linalg.inv(found[0]) @ found[1], np.linalg.inv(frame_of(anchors["camera C"])) @ frame_of(beside)
    np.testing.assert_allclose(between, true, atol=1e-3)
    bare = calibrate(ErrorModel(mechanism, ()), ready(replace(made, table=both)))
    assert np.mean(tool_error(made, fit) ** 2) < 0.2 * np.mean(tool_error(made, bare) ** 2)
