"""The loop on simulated rigs: the input named, the held-out error down to the oracle's, and nothing invented."""

import numpy as np
import pytest
from spherical_cases import HIDDEN, JOINT, NOTHING, THREE, UNDECLARED, Undeclared

import gpmodel as gp
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.calibration.unobservable import unobservable_families
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.evolution.linear import Linear
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.split import hold_out

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
