"""Shift of other findings under each alternative, against fits with each of them."""

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery import acceptance
from gpmodel.discovery.judge import averaged, probabilities, spread_by_rivals
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import Score
from gpmodel.evolution.chance import chance
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.split import JUDGED

ARM = "ur5"
FOUND, RIVAL = (f"{kind}, shoulder_lift_joint" for kind in ("eccentricity, 1 per turn", "joint compliance"))
OTHER = "base compliance"


def test_rivals_move_the_other_findings_as_fits_with_them_say() -> None:
    """A wave at the shoulder in the place of its compliance leaves the tilt of the base to say what both would."""
    arm, data = mechanism(ARM), bare(ARM, 120, 3, payload=False)
    pool = {c.name: c for c in catalogue.candidates(arm, prepare(arm, data).states)}
    at = len(geometric_effects(arm))
    planted = [*pool[RIVAL].effects, *pool[OTHER].effects]
    theta = np.concatenate([sized(ARM, pool[name].effects, data, 0.2) for name in (RIVAL, OTHER)])
    truth = measure(ARM, planted, theta, 3, dataset=data)

    def fitted(name: str) -> tuple[float, float, np.ndarray]:
        """Value of the tilt beside a finding, its standard error, and the tool point, m."""
        model = ErrorModel(arm, (*geometric_effects(arm), *pool[OTHER].effects, *pool[name].effects))
        fit = calibrate(model, truth.poses, condition_limit=first.condition_limit, robust=False)
        return float(fit.theta[at]), float(fit.stderr[at]), fit.placement.tool[""][:3, 3]

    model = ErrorModel(arm, (*geometric_effects(arm), *pool[OTHER].effects, *pool[FOUND].effects))
    first = calibrate(model, truth.poses, robust=False)
    without = residual_of(first, truth.poses, Criteria(), JUDGED).without(pool[FOUND].effects)
    likely = np.array([0.7, 0.3])
    spread = spread_by_rivals(without, pool[FOUND].effects, [pool[RIVAL].effects], likely)
    beside, instead = fitted(FOUND)[0], fitted(RIVAL)[0]
    assert abs(instead - beside) > 3.0 * fitted(FOUND)[1]
    assert spread[pool[OTHER].effects[0].name] == pytest.approx(np.sqrt(0.3) * abs(instead - beside), rel=0.1)
    tool = np.sqrt(0.3) * np.abs(fitted(RIVAL)[2] - fitted(FOUND)[2])
    largest = int(np.argmax(tool))
    assert spread[f"tool T{'xyz'[largest]}"] == pytest.approx(tool[largest], rel=0.25)
    assert spread_by_rivals(without, pool[FOUND].effects, [pool[RIVAL].effects], np.array([0.995, 0.005])) == {}

    score, by_chance, before = Score(0.5, 50.0, 1.0), chance(50.0, np.zeros(9)), cross_validated(without, ())
    errors = {name: cross_validated(without, pool[name].effects).rms for name in (FOUND, RIVAL, OTHER)}
    for own, rival in ((FOUND, RIVAL), (RIVAL, FOUND), (FOUND, OTHER)):
        likely = probabilities([errors[own], errors[rival]], without.freedom)
        judged = averaged(without, acceptance.tested(without, pool[own], score, by_chance, before), [pool[rival]])
        moved = spread_by_rivals(without, pool[own].effects, [pool[rival].effects], likely)
        assert (judged.likely, dict(judged.moved)) == (pytest.approx(likely[0]), pytest.approx(moved))
        assert judged.rivals == ((rival, pytest.approx(errors[rival])),)
    alone = averaged(without, acceptance.tested(without, pool[FOUND], score, by_chance, before), [])
    assert (alone.likely, alone.rivals) == (1.0, ())


def test_a_model_that_leaves_as_much_is_as_likely() -> None:
    assert probabilities([1e-4, 1e-4, 2e-4], 200.0) == pytest.approx([0.5, 0.5, 0.0], abs=1e-12)
    assert probabilities([1.0, 1.0 + np.log(3.0) / 100.0], 100.0)[0] == pytest.approx(0.75, abs=2e-3)
