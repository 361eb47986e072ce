"""A finding that stands in for others is replaced by them; one that is right stays."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, sized
from residual_cases import NAMES, pool, seen

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.cross_validation import cross_validated
from gpmodel.discovery.replacement import better
from gpmodel.discovery.residual import Residual, residual_of
from gpmodel.discovery.score import scores
from gpmodel.discovery.search import Search
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.geometric import geometric_effects

NULLS = {name: np.random.default_rng(0).normal(-5.0, 1.0, 99) for name in ("catalogue", "evolved")}
RULE = Criteria()
PAIRS = (("joint compliance, J4", "joint compliance, J5"), ("base compliance", "gear error, 2 per turn, J4"))


def named(name: str) -> Candidate:
    return next(c for c in pool() if c.name == name)


@cache
def seen_together(names: tuple[str, ...], millimetres: float = 0.3) -> Residual:
    """The residual of ninety poses of a robot with catalogue effects of which the model has none."""
    data = bare("irb6400r", 90, 5)
    effects = [named(name).effects for name in names]
    theta = np.concatenate([sized("irb6400r", e, data, millimetres) for e in effects])
    truth = measure("irb6400r", [e for some in effects for e in some], theta, 5, dataset=data)
    fit = calibrate(ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism)), truth.poses)
    return residual_of(fit, truth.poses, RULE, 0)


def replaced(there: Residual, finding: Candidate, criteria: Criteria = RULE) -> tuple[Hypothesis, ...]:
    return better(replace(there, criteria=criteria), finding, pool(), NULLS, Search())


@pytest.mark.parametrize("planted", [n for n in NAMES if "row" not in n])
def test_the_right_finding_stays(planted: str) -> None:
    assert replaced(seen(planted), named(planted)) == ()


@pytest.mark.parametrize("pair", PAIRS)
def test_the_right_finding_stays_where_another_is_still_to_be_found(pair: tuple[str, str]) -> None:
    for name in pair:
        assert replaced(seen_together(pair), named(name)) == ()


def test_a_stand_in_for_two_is_replaced_by_the_two() -> None:
    there = seen_together(PAIRS[0])
    found = replaced(there, named("joint bending, J6"))
    assert {h.candidate.name for h in found} == set(PAIRS[0])
    assert all(h.accepted and h.cv_rms < h.cv_before for h in found)


def test_a_stand_in_for_one_is_replaced_by_the_one() -> None:
    (found,) = replaced(seen(NAMES[1]), named("transmission ripple, 3 per turn, J4"))
    assert found.candidate.name == NAMES[1]
    assert found.accepted


def test_what_does_not_pass_the_tests_of_a_finding_replaces_nothing() -> None:
    stand_in = named("transmission ripple, 3 per turn, J4")
    assert replaced(seen(NAMES[1]), stand_in, Criteria(significance=0.0)) == ()


def test_effects_with_priors_are_neither_replaced_nor_put_in() -> None:
    believed = [c for c in pool() if c.has_priors]
    assert believed
    assert replaced(seen(NAMES[1]), believed[0]) == ()
    assert better(seen(NAMES[1]), named("base compliance"), believed, NULLS, Search()) == ()


def test_the_residual_beside_an_effect_is_that_of_a_model_with_it() -> None:
    there = seen_together(PAIRS[1])
    first, second = (named(name) for name in PAIRS[1])
    model = there.calibration.model
    fit = calibrate(replace(model, effects=(*model.effects, *first.effects)), there.poses)
    refitted = scores(residual_of(fit, there.poses, RULE, 0), [second])[0]
    beside = there.beside(first.effects)
    (score,) = scores(beside, [second])
    assert score.gain == pytest.approx(refitted.gain, rel=0.01)
    assert score.nats == pytest.approx(refitted.nats, rel=0.02)
    both = cross_validated(there, (*first.effects, *second.effects)).rms
    assert cross_validated(beside, second.effects).rms == pytest.approx(both, rel=1e-6)
