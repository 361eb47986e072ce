"""Test that each kind of measurement in a table counts by its own noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from effect_cases import Truth, bare, measure, mechanism, true_tips
from instances import some

import gpmodel as gp
from gpmodel.api.evolve import _start as start_of_evolve
from gpmodel.api.fleet import _judged as judged_fleet
from gpmodel.calibration import gauss_newton
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.formula.expression import Expression
from gpmodel.hierarchy.further import further_machine
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, drive_effect
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.model.observation import observations
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.table.blocks import hold_out

ARM, COUNT = "irb6400r", 400
WIRES = tuple(f"distance_{i}" for i in range(4))
TABLES: dict[str, dict[str, float]] = {
    "a tracker": {"position": 3e-5},
    "a tracker and draw wires": {"position": 3e-5, **dict.fromkeys(WIRES, 3e-4)},
    "a coarse tracker and interferometers": {"position": 3e-4, **dict.fromkeys(WIRES, 1e-5)},
    "four unequal wires": dict(zip(WIRES, (1e-5, 3e-5, 1e-4, 1e-3), strict=True)),
    "coarse orientations": {"position": 3e-5, "rotation": 1e-3},
    "fine orientations": {"position": 3e-4, "rotation": 2e-5},
    "all": {"position": 3e-5, "rotation": 1e-3, **dict.fromkeys(WIRES, 3e-4)},
}


def planted(noise: Mapping[str, float], effects: Sequence[Effect] = (), seed: int = 1) -> tuple[Truth, Poses]:
    """Poses of an arm that several instruments measured, each with its own noise."""
    see = tuple({name.partition("_")[0]: None for name in noise})
    truth = measure(ARM, effects, [2e-4] * len(effects), seed, count=COUNT, noise=0.0, geometry=0.0, see=see)
    rng, data = np.random.default_rng([seed, 9]), truth.poses.dataset
    rotation = data.rotation
    if "rotation" in noise:
        turned = np.zeros((2, COUNT, 6))
        turned[:, :, 3:] = noise["rotation"] * rng.normal(size=(COUNT, 3)), data.rotation
        rotation = se3.rotation_vector((se3.exp(turned[0]) @ se3.exp(turned[1]))[:, :3, :3])
    data = replace(
        data, rotation=rotation, position=data.position + noise.get("position", 0.0) * rng.normal(size=(COUNT, 3)),
        distances={name: values + noise[name] * rng.normal(size=COUNT) for name, values in data.distances.items()},
    )  # fmt: skip
    return truth, prepare(truth.model.mechanism, data)


def standard(mechanism: Mechanism) -> ErrorModel:
    return ErrorModel(mechanism, geometric_effects(mechanism))


def error_at_new_poses(fit: Calibration, truth: Truth) -> float:
    """RMS error of points that nobody measured, in the frame of the robot that fits best, m."""
    poses = prepare(truth.model.mechanism, bare(ARM, 300, 77, payload=False))
    exact = true_tips(truth, poses)
    seen = observe(fit.model, poses, fit.theta, fit.placement).tip[:, :3, 3]
    turn, shift = se3.fit_rotation(seen, exact)
    return float(np.sqrt(np.mean(np.sum((seen @ turn.T + shift - exact) ** 2, axis=1))))


@pytest.mark.first(3)
@pytest.mark.parametrize("table", TABLES)
def test_kinds_count_by_their_own_noise(table: str, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = TABLES[table]
    truth, poses = planted(noise)
    model = standard(truth.model.mechanism)
    fit = calibrate(model, poses)
    assert fit.status == "converged"
    for kind in observations(poses.dataset):
        if kind.name in noise:
            assert fit.noise_of(kind) == pytest.approx(noise[kind.name], rel=0.1), kind.name
    known = fit.free
    assert (np.abs(fit.theta[known]) < 3.5 * fit.stderr[known]).all()
    if "position" in noise:
        for number, value in zip(fit.placement_numbers[:3], truth.placement.registration[""][:3, 3], strict=False):
            assert abs(number.value - value) < 3.0 * number.stderr, number.name
    least = min(noise.values())
    exact = {name: least / sigma for name, sigma in noise.items()}
    monkeypatch.setattr(gauss_newton, "estimated_weights", lambda fitting, *_: {**fitting.weights, **exact})
    best = calibrate(model, poses)
    assert error_at_new_poses(fit, truth) <= 1.05 * error_at_new_poses(best, truth)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    "noise", [{"tracker": "0.03 mm", "inclinometer": "0.02 deg"}, {"tracker": "0.3 mm", "camera": "0.05 px"}]
)
def test_pixels_and_inclinations_count_by_their_own_noise(noise: Mapping[str, str]) -> None:
    units = {"mm": ("position", 1e-3), "deg": ("inclination", float(np.radians(1.0))), "px": ("pixel", 1.0)}
    parts = {name: gp.simulate(ARM, poses=100, instrument=name, noise=size, seed=3) for name, size in noise.items()}
    described = {key: value for made in parts.values() for key, value in made.table.described.items()}
    frame = pd.concat([made.to_dataframe() for made in parts.values()], ignore_index=True)
    arm = parts["tracker"].truth.mechanism
    poses = prepare(arm, with_observations(gp.read_table(frame, ARM, **described), arm))
    fit = calibrate(standard(arm), poses)
    kinds = {kind.name: kind for kind in observations(poses.dataset)}
    for size in noise.values():
        value, _, unit = size.partition(" ")
        name, factor = units[unit]
        assert fit.noise_of(kinds[name]) == pytest.approx(float(value) * factor, rel=0.1), name


def test_outliers_of_a_fine_instrument_are_excluded_and_no_rows_of_a_coarse_one() -> None:
    truth, poses = planted(TABLES["a tracker and draw wires"])
    data = poses.dataset
    position, distances = data.position.copy(), {name: v.copy() for name, v in data.distances.items()}
    position[200:] = np.nan
    for values in distances.values():
        values[:200] = np.nan
    position[:6] += 1e-3
    fit = calibrate(
        standard(truth.model.mechanism),
        prepare(truth.model.mechanism, replace(data, position=position, distances=distances)),
    )
    assert fit.outliers.tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.long
def test_a_search_weighs_kinds_again_after_every_finding() -> None:
    """Before the first finding all kinds have the residual of the effect, whatever their noise."""
    noise = {"position": 1e-5, **dict.fromkeys(WIRES, 4e-4)}
    joint = mechanism(ARM).joints[3]
    truth, poses = planted(noise, [drive_effect(f"true {f}", joint, Expression(f"{f}(2*J4)")) for f in ("sin", "cos")])
    train, heldout = hold_out(poses.dataset, 0.25, np.random.default_rng(0))
    found = discover(truth.model.mechanism, poses, train, heldout, search=Search(runs=0))
    assert [finding.candidate.family for finding in found.findings] == ["gear_harmonic"]
    for kind in observations(poses.dataset):
        if kind.name in noise:
            assert found.final.noise_of(kind) == pytest.approx(noise[kind.name], rel=0.1), kind.name
    assert error_at_new_poses(found.final, truth) < noise["position"]


def of_evolve(arm: Mechanism, poses: Poses, effects: tuple[Effect, ...]) -> Sequence[Step]:
    models = (("standard", geometric_effects(arm)), ("effects", (*geometric_effects(arm), *effects)))
    return start_of_evolve(poses, np.arange(60), models, (arm, 0)).steps


def of_a_fleet(arm: Mechanism, poses: Poses, effects: tuple[Effect, ...]) -> Sequence[Step]:
    parts = [poses.subset(np.arange(k, 80, 2)) for k in range(2)]
    rows = [(np.arange(35), np.arange(35, 40))] * 2
    model = (*geometric_effects(arm), *effects)
    return judged_fleet([(arm, part) for part in parts], rows, [[("registration", ()), ("all", model)]] * 2, model, 0)[
        0
    ]


def of_a_further_machine(arm: Mechanism, poses: Poses, effects: tuple[Effect, ...]) -> Sequence[Step]:
    tables = {str(k): poses.subset(np.arange(k, 80, 2)).dataset for k in range(2)}
    fleet = gp.fleet(arm, tables, list(effects), holdout=0.0)
    return further_machine(fleet.record, arm, poses.subset(np.arange(60)), poses.subset(np.arange(60, 80))).steps


@pytest.mark.parametrize("steps_of", some([of_evolve, of_a_fleet, of_a_further_machine], of_evolve, of_a_fleet))
def test_all_steps_of_a_ladder_weigh_the_kinds_alike(
    steps_of: Callable[[Mechanism, Poses, tuple[Effect, ...]], Sequence[Step]],
) -> None:
    """The first model lacks an effect, by which positions and coarse distances have about equal residuals."""
    arm = mechanism("ur5")
    wave = drive_effect("wave", arm.joints[1], Expression(f"sin(2*{arm.joints[1].name})"))
    data = measure("ur5", (wave,), [5e-3], 3, count=80, see=("position", "distance")).poses.dataset
    off = np.random.default_rng(0).normal(0.0, 1e-3, 80)
    poses = prepare(arm, replace(data, distances={name: values + off for name, values in data.distances.items()}))
    first, *_, last = steps_of(arm, poses, (wave,))
    train = poses.subset(np.arange(60) if steps_of is not of_a_fleet else np.arange(0, 70, 2))
    weighed, own = (errors_on(first.calibration, train, fit.calibration.weights) for fit in (last, first))
    assert np.abs(np.log(weighed / own)).max() > 0.2
    assert first.train_error == pytest.approx(weighed)


@pytest.mark.long
@pytest.mark.parametrize("stated", ["0.3 mm", "0.05 px"])
def test_a_stated_noise_counts_by_the_weight_of_the_kind_that_it_names(stated: str) -> None:
    """By the fit, 0.05 px count as 0.3 mm."""
    noise = {"tracker": "0.3 mm", "camera": "0.05 px"}
    parts = {name: gp.simulate("ur5", poses=25, instrument=name, noise=size, seed=3) for name, size in noise.items()}
    described = {key: value for made in parts.values() for key, value in made.table.described.items()}
    frame = pd.concat([made.to_dataframe() for made in parts.values()], ignore_index=True)
    table = gp.read_table(frame, "ur5", **described)
    found = gp.discover("ur5", table, noise=stated, search=gp.Search(runs=0, workers=1), candidates=(), holdout=0.3)
    assert found.origin.noise == pytest.approx(3e-4, rel=0.15)
