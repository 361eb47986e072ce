"""Test that every acceptance rule can reject a candidate and states the reason."""

from dataclasses import replace

import numpy as np
import pytest
from residual_cases import NAMES, best_nats, pool, seen

from gpmodel.discovery import acceptance
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.score import Score, scores
from gpmodel.evolution.chance import PValue, chance_of
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect

LOW = np.random.default_rng(0).normal(-5.0, 1.0, 99)
RULE = Criteria()


def unnamed() -> tuple[Candidate, ...]:
    """The shapes of the catalogue as if they had been evolved."""
    return tuple(replace(c, family="", found_by="sequence") for c in pool() if not c.has_priors)


def strongest(planted: str, null: np.ndarray = LOW, criteria: Criteria = RULE) -> Hypothesis:
    """The candidate of largest gain, tested."""
    there = replace(seen(planted), criteria=criteria)
    ranked = sorted(zip(unnamed(), scores(there, unnamed()), strict=True), key=lambda one: -one[1].nats)
    candidate, score = ranked[0]
    return acceptance.tested(there, candidate, score, chance_of(score.nats, null), cross_validated(there, ()))


@pytest.mark.long
@pytest.mark.parametrize("planted", [NAMES[0], NAMES[1], NAMES[2]])
def test_a_planted_effect_is_accepted(planted: str) -> None:
    found = strongest(planted)
    assert found.accepted
    assert found.cv_rms < found.cv_before


@pytest.mark.long
def test_nothing_is_accepted_where_permuted_residuals_do_as_well() -> None:
    best = max(s.nats for s in scores(seen(NAMES[1]), pool()))
    found = strongest(NAMES[1], null=best + np.random.default_rng(0).normal(0.0, 1.0, 99))
    assert not found.accepted
    assert "probability on residuals with random signs" in found.why


@pytest.mark.long
def test_nothing_is_accepted_of_a_robot_without_an_undeclared_effect() -> None:
    there = seen("nothing")
    null = best_nats(there, unnamed(), there.permuted(np.random.default_rng(1), 60))
    assert not strongest("nothing", null=null).accepted


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("rule", "limit", "said"),
    [
        ("significance", 0.0, "probability on residuals with random signs"),
        ("minimum_nats", 1e6, "net gain"),
        ("clear_cv_t", 1e6, "cross-validated gain"),
        ("minimum_share", 1.1, "unique share"),
    ],
)
def test_each_rule_alone_refuses_and_says_so(rule: str, limit: float, said: str) -> None:
    found = strongest(NAMES[2], criteria=Criteria(**{rule: limit}))  # type: ignore[arg-type]
    assert not found.accepted
    assert said in found.why
    assert ";" not in found.why


@pytest.mark.parametrize(("own", "refused"), [(0.002, True), (0.2, False)])
def test_a_term_whose_motion_is_a_hundred_times_its_own_is_refused(own: float, refused: bool) -> None:
    """The joint's zero holds the constant part; what is the term's own is the planted ripple either way."""
    there = seen(NAMES[1])
    joint = there.calibration.model.mechanism.joints[3]
    columns, _ = there.projected(next(c for c in pool() if c.name == NAMES[1]).effects)
    sine, cosine = np.linalg.lstsq(columns, there.values)[0] / np.linalg.norm(there.values)
    text = f"1 + {own}*({sine:.4f}*sin(2*J4) + {cosine:.4f}*cos(2*J4))"
    term = Candidate("term", (drive_effect("term", joint, Expression(text)),), "gear_harmonic", 1.0)
    hypothesis = acceptance.tested(there, term, Score(0.3, 30.0, own), PValue(1e-6, 99), cross_validated(there, ()))
    assert [t.name for t in hypothesis.verdict.tests if not t.passed] == ["unique share"] * refused
