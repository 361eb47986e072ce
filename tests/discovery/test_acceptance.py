"""Accepting one hypothesis: every rule can refuse, what looks alike is one finding, and only one is accepted."""

from dataclasses import replace

import numpy as np
import pytest
from residual_cases import NAMES, pool, seen

from gpmodel.discovery import acceptance
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.pool import Pool, pool_of
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.null import shuffled
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import best_nats, scores
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect

LOW = np.random.default_rng(0).normal(-5.0, 1.0, 99)


RULE = Criteria()


def judge(residual: Residual, pool: Pool, criteria: Criteria = RULE) -> tuple[Hypothesis, ...]:
    return acceptance.judge(replace(residual, criteria=criteria), pool, Search())


def judged(
    planted: str, extra: tuple[Candidate, ...] = (), null: np.ndarray = LOW, criteria: Criteria = RULE
) -> tuple[Hypothesis, ...]:
    there = seen(planted)
    candidates = (*pool(), *extra)
    return judge(there, pool_of(there, candidates, {"catalogue": null, "evolved": null}), criteria)


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
    null = best_nats(there, pool(), shuffled(there, np.random.default_rng(1), 60))
    assert not any(h.accepted for h in judged("nothing", null=null))


@pytest.mark.parametrize(
    ("rule", "limit", "said"),
    [
        ("significance", 0.0, "chance of it"),
        ("minimum_nats", 1e6, "description length"),
        ("minimum_cv_t", 1e6, "cross-validated gain"),
        ("minimum_sigmas", 1e6, "sigma, limit"),
        ("minimum_share", 1.1, "unique share"),
    ],
)
def test_each_rule_alone_refuses_and_says_so(rule: str, limit: float, said: str) -> None:
    (first, *_) = judged(NAMES[1], criteria=Criteria(**{rule: limit}))  # type: ignore[arg-type]
    assert not first.accepted
    assert said in first.why
    assert ";" not in first.why


def test_a_sign_that_changes_between_folds_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(acceptance, "_sign_is_stable", lambda coefficients: False)
    assert judged(NAMES[1])[0].why == "sign changes between folds"


@pytest.mark.parametrize(
    ("coefficients", "stable"),
    [([[3.0, 0.1], [2.0, -0.1]], True), ([[3.0, 0.1], [-0.2, 0.1]], False), ([[-1.0], [-2.0]], True)],
)
def test_the_leading_coefficient_keeps_its_sign_or_not(coefficients: list[list[float]], stable: bool) -> None:
    assert bool(acceptance._sign_is_stable(np.array(coefficients))) is stable


def test_what_gp_found_takes_the_catalogues_word_and_keeps_how_it_was_found() -> None:
    joint = seen(NAMES[2]).calibration.model.mechanism.joints[4]
    evolved = Candidate(
        "J4 + 0.001 on J5", (drive_effect("J4 + 0.001 on J5", joint, Expression("J4 + 0.001")),), "", 1.0, "evolved"
    )
    first = judged(NAMES[2], (evolved,))[0]
    assert first.candidate.name == NAMES[2]
    assert first.candidate.found_by == "evolved"
    assert evolved.name not in [name for name, _ in first.rivals], "the same place and input is no rival"


def test_what_matches_no_family_keeps_its_expression() -> None:
    there = seen(NAMES[2])
    joint = there.calibration.model.mechanism.joints[4]
    bend = Candidate("bend", (drive_effect("bend", joint, Expression("J4")),), "", 1.0, "evolved")
    others = tuple(c for c in pool() if c.name != NAMES[2] and "J4" not in c.name)
    found = judge(there, pool_of(there, (*others, bend), {"catalogue": LOW, "evolved": LOW}))
    assert found[0].accepted
    assert found[0].candidate == replace(bend, found_by="evolved")
    assert found[0].candidate.family == ""


def test_alike_columns_are_one_finding_with_rivals() -> None:
    joint = seen(NAMES[1]).calibration.model.mechanism.joints[3]

    def twin(k: int) -> Candidate:
        bases = [Expression(f"{k}*{f}(2*J4)") for f in ("sin", "cos")]
        return Candidate(f"twin {k}", tuple(drive_effect(f"twin {k} {b}", joint, b) for b in bases), "", 1.0)

    twins = (twin(2), twin(3))
    found = judged(NAMES[1], twins)
    names = [h.candidate.name for h in found]
    assert len({"twin 2", "twin 3", NAMES[1]} & set(names)) == 1
    assert all(np.isfinite(rms) for _, rms in found[0].rivals)


def test_p_values_pay_for_the_number_of_searches() -> None:
    there = seen(NAMES[1])
    candidates = pool()
    found = scores(there, candidates)
    best = int(np.argmax([s.nats for s in found]))
    null = found[best].nats + np.random.default_rng(0).normal(0.0, 1.0, 200)
    one = Pool(candidates, found, {"catalogue": null}).chance(best).p
    two = Pool(candidates, found, {"catalogue": null, "evolved": null}).chance(best).p
    assert two == pytest.approx(min(1.0, 2 * one))
    assert 0.2 < one <= 1.0


def expression(text: str, cost: float) -> Candidate:
    joint = seen(NAMES[1]).calibration.model.mechanism.joints[3]
    return Candidate(text, (drive_effect(text, joint, Expression(text)),), "", cost, "evolved")


@pytest.mark.parametrize(("ahead", "named"), [(4.0, True), (6.0, False)])
def test_a_named_effect_comes_before_an_expression_that_saves_little_more(ahead: float, named: bool) -> None:
    """The planted effect and an expression at another place, with description lengths set by hand."""
    there = seen(NAMES[1])
    gear = next(c for c in pool() if c.name == NAMES[1])
    other = expression("J5 * J6", 1.0)
    (best,) = scores(there, [gear])
    told = (best, replace(best, nats=best.nats + ahead))
    first = judge(there, Pool((gear, other), told, {"catalogue": LOW, "evolved": LOW}))[0]
    assert (first.candidate.name == gear.name) is named


def test_of_expressions_that_save_as_much_the_plainest_speaks() -> None:
    there = seen(NAMES[1])
    plain, long, worse = (
        expression(t, 1.0) for t in ("sin(2*J4)", "sin(2*sin(J4) + 2*(J4 - sin(J4)))", "2*sin(J4)*cos(J4)")
    )
    (score,) = scores(there, [plain])
    told = (replace(score, nats=score.nats + 0.5), score, replace(score, nats=score.nats - 3.0))
    found = judge(there, Pool((long, plain, worse), told, {"catalogue": LOW, "evolved": LOW}))
    assert found[0].candidate == plain
    assert found[0].score.nats == score.nats


def test_a_spike_at_the_worst_pose_does_not_ride_along() -> None:
    there = seen(NAMES[1])
    shapes = [expression(text, 1.0).effects[0] for text in ("sin(2*J4)", "cos(2*J4)", "exp(-(row - 17)**2)")]
    assert acceptance.every_part_counts(there, Candidate("the two", tuple(shapes[:2]), "", 1.0, "evolved"))
    assert not acceptance.every_part_counts(there, Candidate("and a spike", tuple(shapes), "", 1.0, "evolved"))
    assert not acceptance.every_part_counts(there, Candidate("a spike", tuple(shapes[2:]), "", 1.0, "evolved"))


def test_a_part_that_does_not_predict_does_not_ride_along() -> None:
    there = seen(NAMES[1])
    shapes = [expression(text, 1.0).effects[0] for text in ("sin(2*J4)", "cos(2*J4)", "J1*J6")]
    assert not acceptance.every_part_counts(there, Candidate("and more", tuple(shapes), "", 1.0, "evolved"))


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
