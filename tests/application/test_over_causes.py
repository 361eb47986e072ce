"""Test the standard errors over the causes of findings, and over one effect that was not found."""

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.application.over_causes import over_causes
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.families import catalogue
from gpmodel.model.error_model import prepare

FOUND, ABSORBED = "joint compliance, shoulder_lift_joint", "base compliance"


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    ("base", "unaware"), [(1e-6, 7.0), (2e-6, 15.0), pytest.param(6e-6, 30.0, marks=pytest.mark.long), (9e-6, 30.0)]
)
def test_a_finding_allows_for_an_effect_that_it_absorbs(seed: int, base: float, unaware: float) -> None:
    """The moments of base and shoulder are alike, so that the shoulder seems as soft as both together. A base with a
    tenth or a fifth of the shoulder's compliance leaves no evidence of its own."""
    arm, data = mechanism("ur5"), bare("ur5", 90, seed, payload=False)
    pool = {c.name: c for c in catalogue.candidates(arm, prepare(arm, data).states)}
    sizes = (1e-5, base)
    effects = (*pool[FOUND].effects, *pool[ABSORBED].effects)
    poses = measure("ur5", effects, sizes, seed, dataset=data, noise=2e-5).poses
    nothing = np.zeros(0, dtype=np.int64)
    search = Search(runs=0, workers=1)
    found = discover(arm, poses, np.arange(90), nothing, candidates=(pool[FOUND],), search=search)

    def off(fit: Calibration) -> float:
        k = [e.name for e in fit.model.effects].index(FOUND)
        return float(abs(fit.theta[k] - sizes[0]) / fit.stderr[k])

    assert off(found.final) > unaware
    assert off(over_causes(found).final) < 2.0
