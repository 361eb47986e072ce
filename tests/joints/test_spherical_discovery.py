"""Test the search on simulated rigs: the true input is named, the error is the oracle's."""

from collections.abc import Callable

import numpy as np
import pytest
from instances import some
from spherical_cases import HIDDEN, JOINT, NOTHING, OFFSETS, THREE, UNDECLARED, Undeclared

import gpmodel as gp
from experiments.spherical_joint.rig import Rig
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.calibration.unobservable import unobservable_families
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.evolution.linear import Linear
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import hold_out

SEED = 1
QUICK = ("pitch axis Ty sin J1",)


def run(case: Undeclared) -> tuple[Discovery, Poses]:
    data = case.table(SEED)
    poses = prepare(JOINT, data)
    train, heldout = hold_out(data, 0.3, np.random.default_rng(SEED))
    search = Search(runs=3, workers=1, strategies=(Linear(),))
    return discover(JOINT, poses, train, heldout, search=search, seed=SEED), poses


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.long
@pytest.mark.parametrize(
    "case", [pytest.param(c, id=c.name, marks=() if c.name in QUICK else pytest.mark.slow) for c in UNDECLARED]
)
def test_an_undeclared_effect_is_found_and_the_error_falls_to_the_oracles(case: Undeclared) -> None:
    found, poses = run(case)
    inputs = {i for f in found.findings for e in f.candidate.effects for i in e.inputs}
    assert inputs & case.inputs
    before, after = found.steps[1].heldout_error, found.steps[-1].heldout_error
    assert after.max() < before.max()
    oracle = calibrate(ErrorModel(JOINT, (*geometric_effects(JOINT), *case.truth)), poses.subset(found.train))
    assert rms(after) < 1.25 * rms(errors_on(oracle, poses.subset(found.heldout)))


@pytest.mark.long
def test_three_effects_at_once_are_chosen_together() -> None:
    data = THREE.table(0)
    poses, (train, heldout) = prepare(JOINT, data), hold_out(data, 0.3, np.random.default_rng(SEED))
    found = discover(JOINT, poses, train, heldout, search=Search(runs=0, workers=1), seed=SEED)
    assert [f.round for f in found.findings] == [1, 1, 1]
    assert {i for f in found.findings for i in f.candidate.inputs} == THREE.inputs
    assert rms(found.steps[-1].heldout_error) < 0.25 * rms(found.steps[1].heldout_error)


@pytest.mark.long
@pytest.mark.parametrize("case", [HIDDEN, pytest.param(NOTHING, marks=pytest.mark.slow)], ids=lambda c: c.name)
def test_nothing_is_invented_and_what_free_angles_hide_is_said(case: Undeclared) -> None:
    found, poses = run(case)
    assert found.findings == ()
    names = unobservable_families(found.final, poses)
    assert {"eccentricity", "gear ratio", "J1 Rx", "J3 Rz"} <= set(names)
    assert not {"axis run out", "drift", "ball lobes", "J1 Tz"} & set(names)


@pytest.mark.long
def test_the_noise_floor_is_of_what_free_angles_leave() -> None:
    """Three angles absorb two of three coordinates."""
    made = gp.simulate("spherical-joint", poses=40, noise="0.03 mm", seed=1)
    run_out = gp.effect_at("run-out", "J1.moving", "Tx", gp.Expression("sin(J1)"))
    found = gp.discover("spherical-joint", made.table, search=gp.Search(runs=0), candidates=[run_out], holdout=0.3,
                        noise="0.03 mm")  # fmt: skip
    assert found.record.noise_floor_mm == pytest.approx(0.03, rel=0.05)


LOBE, GROWTH = 8e-6, 0.4e-6
WEAK: dict[str, tuple[str, Callable[[Array, Array], dict[int, Array]], tuple[float, ...]]] = {
    "ball": (
        "out-of-round ball, 2 lobes over J1, lift along z",
        lambda q, warm: {3: LOBE * np.sin(2 * q[:, 0])},
        (LOBE, 0.0),
    ),
    "pitch axis": (
        "axis run-out, 2 per turn, J1 Tz",
        lambda q, warm: {15: LOBE * np.sin(2 * q[:, 0])},
        (LOBE, 0.0),
    ),
    "shaft": (
        "thermal growth of the arm (temperature)",
        lambda q, warm: {27: GROWTH * (warm - 22.0)},
        (GROWTH * JOINT.tooling_ball[2] / float(np.dot(JOINT.tooling_ball, JOINT.tooling_ball)),),
    ),
}


@pytest.mark.parametrize("seed", some(range(3), 0))
@pytest.mark.parametrize("name", some(WEAK, "ball"))
def test_a_weak_effect_fitted_by_its_catalogue_name_is_there_at_its_size(name: str, seed: int) -> None:
    """Growth along z lengthens the lever by its share along it; 15 to 30 degC, as a hall has over a day."""
    candidate, disturbance, truth = WEAK[name]
    rng = np.random.default_rng(seed)
    rig = Rig(JOINT, parameters=OFFSETS, reach=(1.5, 1.2, 1.5))
    q, warm = rig.poses(60, rng), rng.uniform(15.0, 30.0, 60)
    table = rig.measure(q, rng, {"temperature": ("degC", warm)}, lambda q, extras: disturbance(q, warm))
    poses = prepare(JOINT, table)
    effects = next(c.effects for c in catalogue.candidates(JOINT, poses.states) if c.name == candidate)
    standard = geometric_effects(JOINT)
    bare = calibrate(ErrorModel(JOINT, standard), poses)
    fit = calibrate(ErrorModel(JOINT, (*standard, *effects)), poses)
    found, sigma = fit.theta[len(standard) :], fit.stderr[len(standard) :]
    assert np.abs(found[0]) > 4 * sigma[0]
    assert np.all(np.abs(found - truth) < 4 * sigma)
    assert fit.sigma < bare.sigma
