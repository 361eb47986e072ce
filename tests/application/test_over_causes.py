"""Shift of other findings under each other cause, against fits with each of them."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized

from experiments.spherical_joint.rigs import JOINT, rig_of
from gpmodel.application.over_causes import spread_over, tool_spreads
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.causes import Cause
from gpmodel.selection.group import Group
from gpmodel.table.split import JUDGED

ARM = "ur5"
FOUND, RIVAL = (f"{kind}, shoulder_lift_joint" for kind in ("eccentricity, 1 per turn", "joint compliance"))
OTHER = "base compliance"


@pytest.mark.long
def test_other_causes_move_the_other_findings_as_fits_with_them_say() -> None:
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
    other = [Cause((Group(**vars(pool[RIVAL])),), 0.3, own=False)]
    spread = spread_over(without, pool[FOUND].effects, other)
    beside, instead = fitted(FOUND)[0], fitted(RIVAL)[0]
    assert abs(instead - beside) > 3.0 * fitted(FOUND)[1]
    assert spread[pool[OTHER].effects[0].name] == pytest.approx(np.sqrt(0.3) * abs(instead - beside), rel=0.1)
    tool = np.sqrt(0.3) * np.abs(fitted(RIVAL)[2] - fitted(FOUND)[2])
    largest = int(np.argmax(tool))
    assert spread[f"tool T{'xyz'[largest]}"] == pytest.approx(tool[largest], rel=0.1)
    assert spread_over(without, pool[FOUND].effects, [replace(other[0], probability=0.005)]) == {}


@pytest.mark.long
@pytest.mark.parametrize("seed", [92, 94, 95])
def test_the_radius_of_a_ball_allows_for_lobes_of_any_number_and_for_those_that_are_not_found(seed: int) -> None:
    """Three lobes and an offset look like other lobes, or like another radius: 6, 22 and 27 standard errors off."""
    off, wider = [], []
    for kind in ("lobes", "nothing"):
        rig, data = rig_of(seed, kind, True)
        nothing = np.zeros(0, dtype=np.int64)
        found = discover(JOINT, prepare(JOINT, data), np.arange(60), nothing, search=Search(runs=0, workers=1))
        (radius,) = [p for p in found.final.placed if p.name == "tool z"]
        stderr = np.hypot(radius.stderr, [spread["tool Tz"] for spread in tool_spreads(found)]).max()
        off.append(abs(radius.value - rig.joint.tooling_ball[2] + JOINT.tooling_ball[2]) / stderr)
        wider.append(stderr / radius.stderr)
    assert max(off) < 3.0
    assert wider[0] > 2.0
    assert wider[1] < 1.05
