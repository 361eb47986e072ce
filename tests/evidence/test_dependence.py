"""Test that drifts along rows and smooth errors over space count as few independent poses."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import measure
from group_cases import bars
from instances import some
from loop_cases import ARM
from residual_cases import NAMES, pool, seen

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.dependence import depends_on_time, inflation
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import gains_by_inflation, scores
from gpmodel.evolution.description_length import fit_nats
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects


@pytest.mark.long
@pytest.mark.parametrize("planted", NAMES)
def test_a_true_effect_in_independent_noise_pays_little(planted: str) -> None:
    own = next(c for c in pool() if c.name == planted)
    assert max(inflation(seen(planted), own).values()) < 2.5


@pytest.mark.long
def test_where_nothing_depends_on_anything_no_candidate_pays_for_chance() -> None:
    """With ten stretches, one candidate in thirty is 2 to 3 times above independence by chance. The model's columns
    say by how much; they say nothing of slow candidates that read a clock.
    """
    residual = seen(NAMES[2])
    slow, quick = [], []
    for candidate in pool():
        factor = max(inflation(residual, candidate).values())
        (slow if depends_on_time(candidate, residual.poses.states) else quick).append(factor)
    assert max(quick) == 1.0
    assert max(slow) > 2.0


@pytest.mark.long
def test_both_ends_of_a_bar_are_one_length_and_no_dependence() -> None:
    _, poses, fit = bars()
    residual = residual_of(fit, poses, Criteria(), 0)
    steps = [c for c in catalogue.candidates(fit.model.mechanism, poses.states) if "joint compliance" in c.name]
    assert steps
    assert {inflation(residual, candidate)["repeats"] for candidate in steps} == {1.0}


def wandering(seed: int) -> Residual:
    """An innocent robot whose instrument walks at random through the session."""
    truth = measure(ARM, (), (), seed, count=120)
    walk = np.cumsum(np.random.default_rng(seed).normal(0.0, 2e-5, (120, 3)), axis=0)
    data = replace(truth.poses.dataset, position=truth.poses.dataset.position + walk)
    poses = prepare(truth.model.mechanism, data)
    fit = calibrate(ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism)), poses)
    return residual_of(fit, poses, Criteria(), 0)


@pytest.mark.parametrize("seed", some(range(4), 0))
def test_a_random_walk_costs_a_step_most_of_its_evidence(seed: int) -> None:
    residual = wandering(seed)
    steps = [c for c in pool() if c.family in ("set_up_step", "drift")]
    found = scores(residual, steps)
    best = int(np.argmax([s.nats for s in found]))
    factor = inflation(residual, steps[best])["rows"]
    assert found[best].nats > 5
    assert factor > 2


@pytest.mark.first(3)
@pytest.mark.parametrize("prior", some([np.inf, 1e-4], np.inf))
@pytest.mark.parametrize("planted", NAMES)
def test_evidence_is_of_so_many_times_fewer_readings(planted: str, prior: float) -> None:
    residual, own = seen(planted), next(c for c in pool() if c.name == planted)
    candidate = replace(own, effects=tuple(replace(e, prior=prior) for e in own.effects))
    (score,) = scores(residual, [candidate])
    same, *fewer = gains_by_inflation(residual, candidate, (1.0, 2.0, 8.0, 32.0))
    assert same == pytest.approx(score.nats, rel=1e-12)
    assert fewer == sorted(fewer, reverse=True)
    if prior == np.inf:
        fit = float(fit_nats(score.gain, residual.freedom))
        assert fewer[0] == pytest.approx(score.nats - fit / 2, rel=1e-12)
