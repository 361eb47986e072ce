"""Accepting one hypothesis: every rule can refuse, what looks alike is one finding, and only one is accepted."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from residual_cases import NAMES, pool, seen

from gpmodel.discovery import acceptance, judge
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.judge import plainest
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.score import Score, best_nats, scores
from gpmodel.evolution.chance import Chance
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect

LOW = np.random.default_rng(0).normal(-5.0, 1.0, 99)


RULE = Criteria()


def unnamed() -> tuple[Candidate, ...]:
    """The shapes of the catalogue as if they had been evolved."""
    return tuple(replace(c, family="", found_by="evolved") for c in pool() if not c.has_priors)


def judged(
    planted: str, offered: Sequence[Candidate] = (), null: np.ndarray = LOW, criteria: Criteria = RULE
) -> tuple[Hypothesis, ...]:
    return judge.judge(replace(seen(planted), criteria=criteria), offered or unnamed(), null, Search())


@pytest.mark.parametrize("planted", [NAMES[0], NAMES[1], NAMES[2]])
def test_the_planted_effect_is_accepted_first(planted: str) -> None:
    found = judged(planted)
    assert found[0].accepted
    assert planted in (found[0].candidate.name, *(name for name, _ in found[0].rivals))
    assert found[0].cv_rms < found[0].cv_before
    assert next(t for t in found[0].verdict.tests if t.name == "coefficient").value > 10


def test_nothing_is_accepted_where_chance_does_as_well() -> None:
    best = max(s.nats for s in scores(seen(NAMES[1]), pool()))
    found = judged(NAMES[1], null=best + np.random.default_rng(0).normal(0.0, 1.0, 99))
    assert not any(h.accepted for h in found)
    assert "chance of it on shuffled residuals" in found[0].why


def test_nothing_is_accepted_of_an_innocent_robot() -> None:
    there = seen("nothing")
    null = best_nats(there, unnamed(), there.shuffled(np.random.default_rng(1), 60))
    assert not any(h.accepted for h in judged("nothing", null=null))


@pytest.mark.parametrize(
    ("rule", "limit", "said"),
    [
        ("significance", 0.0, "chance of it"),
        ("minimum_nats", 1e6, "description length"),
        ("clear_cv_t", 1e6, "cross-validated gain"),
        ("minimum_sigmas", 1e6, "sigma, limit"),
        ("minimum_share", 1.1, "unique share"),
    ],
)
def test_each_rule_alone_refuses_and_says_so(rule: str, limit: float, said: str) -> None:
    (first, *_) = judged(NAMES[2], criteria=Criteria(**{rule: limit}))  # type: ignore[arg-type]
    assert not first.accepted
    assert said in first.why
    assert ";" not in first.why


@pytest.mark.parametrize(("own", "refused"), [(0.002, True), (0.2, False)])
def test_a_term_whose_motion_is_a_hundred_times_its_own_is_refused(own: float, refused: bool) -> None:
    """The joint's zero holds the constant part; what is the term's own is the planted ripple either way."""
    there = seen(NAMES[1])
    joint = there.calibration.model.mechanism.joints[3]
    columns, _ = there.projected(next(c for c in pool() if c.name == NAMES[1]).effects)
    sine, cosine = np.linalg.lstsq(columns, there.values)[0] / np.linalg.norm(there.values)
    text = f"1 + {own}*({sine:.4f}*sin(2*J4) + {cosine:.4f}*cos(2*J4))"
    term = Candidate("term", (drive_effect("term", joint, Expression(text)),), "gear_harmonic", 1.0)
    hypothesis = acceptance.tested(there, term, Score(0.3, 30.0, own), Chance(1e-6, 99), cross_validated(there, ()))
    assert [t.name for t in hypothesis.verdict.tests if not t.passed] == ["unique share"] * refused


def test_a_sign_that_changes_between_folds_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(acceptance, "_sign_is_stable", lambda coefficients: False)
    assert judged(NAMES[1])[0].why == "sign changes between folds"


@pytest.mark.parametrize(
    ("coefficients", "stable"),
    [([[3.0, 0.1], [2.0, -0.1]], True), ([[3.0, 0.1], [-0.2, 0.1]], False), ([[-1.0], [-2.0]], True)],
)
def test_the_leading_coefficient_keeps_its_sign_or_not(coefficients: list[list[float]], stable: bool) -> None:
    assert bool(acceptance._sign_is_stable(np.array(coefficients))) is stable


def test_alike_columns_are_one_finding_with_rivals() -> None:
    joint = seen(NAMES[1]).calibration.model.mechanism.joints[3]

    def twin(k: int) -> Candidate:
        bases = [Expression(f"{k}*{f}(2*J4)") for f in ("sin", "cos")]
        return Candidate(f"twin {k}", tuple(drive_effect(f"twin {k} {b}", joint, b) for b in bases), "", 1.0, "evolved")

    found = judged(NAMES[1], (*unnamed(), twin(2), twin(3)))
    names = [h.candidate.name for h in found]
    assert len({"twin 2", "twin 3", NAMES[1]} & set(names)) == 1
    assert all(np.isfinite(rms) for _, rms in found[0].rivals)


def expression(text: str, cost: float) -> Candidate:
    joint = seen(NAMES[1]).calibration.model.mechanism.joints[3]
    return Candidate(text, (drive_effect(text, joint, Expression(text)),), "", cost, "evolved")


def test_of_expressions_that_save_as_much_the_plainest_speaks() -> None:
    """Description lengths set by hand."""
    plain, long, worse = (
        expression(t, 1.0) for t in ("sin(2*J4)", "sin(2*sin(J4) + 2*(J4 - sin(J4)))", "2*sin(J4)*cos(J4)")
    )
    (score,) = scores(seen(NAMES[1]), [plain])
    nats = [score.nats + ahead for ahead in (0.5, 0.0, -3.0)]
    alike = [(c, replace(score, nats=n)) for c, n in zip((long, plain, worse), nats, strict=True)]
    assert plainest(RULE, alike) == (plain, score)


def test_a_spike_at_the_worst_pose_does_not_ride_along() -> None:
    there = seen(NAMES[1])
    shapes = [expression(text, 1.0).effects[0] for text in ("sin(2*J4)", "cos(2*J4)", "exp(-(row - 17)**2)")]
    assert judge.every_part_counts(there, Candidate("the two", tuple(shapes[:2]), "", 1.0, "evolved"))
    assert not judge.every_part_counts(there, Candidate("and a spike", tuple(shapes), "", 1.0, "evolved"))
    assert not judge.every_part_counts(there, Candidate("a spike", tuple(shapes[2:]), "", 1.0, "evolved"))


def test_a_part_that_does_not_predict_does_not_ride_along() -> None:
    there = seen(NAMES[1])
    shapes = [expression(text, 1.0).effects[0] for text in ("sin(2*J4)", "cos(2*J4)", "J1*J6")]
    assert not judge.every_part_counts(there, Candidate("and more", tuple(shapes), "", 1.0, "evolved"))


def test_what_passes_by_itself_is_offered_to_the_selection_and_not_yet_added() -> None:
    first, *_ = judged(NAMES[1])
    assert (first.accepted, first.added, first.why) == (True, False, "passes, offered to the selection")
    failed = next(h for h in judged(NAMES[1]) if not h.accepted)
    assert "limit" in failed.why


def test_what_was_searched_for_twice_has_the_larger_chance() -> None:
    first, *_ = judged(NAMES[1])
    likely = replace(first, chance=replace(first.chance, p=0.004))
    other = replace(first, candidate=expression("J5*J6", 1.0), chance=replace(first.chance, p=0.9))
    assert acceptance.as_searched(first, [likely, other]).p_value == 0.004
    assert acceptance.as_searched(likely, [first]).p_value == 0.004
    term = expression("J5*J6", 1.0)
    both = replace(term, name="both", effects=(*term.effects, *expression("J2", 1.0).effects))
    found = replace(first, candidate=both, chance=replace(first.chance, p=0.003))
    assert acceptance.as_searched(replace(first, candidate=term), [found]).p_value == 0.003
