"""The tests of a candidate, and the verdicts on the best of a pool."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel import wording
from gpmodel.arrays import Array
from gpmodel.discovery.naming import Scored, plainest, rivals
from gpmodel.discovery.search import Search
from gpmodel.discovery.walk import beyond_a_walk
from gpmodel.evidence.criteria import Test, Verdict
from gpmodel.evidence.cross_validation import Predicted, better_by, cross_validated, gained
from gpmodel.evidence.dependence import inflation, order_matters
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import Score, deflated, scores
from gpmodel.evolution.chance import Chance, chance, larger
from gpmodel.families.candidate import Candidate
from gpmodel.numerics import rank as ident


@dataclass(frozen=True)
class Hypothesis:
    """A candidate with its score, p-value, rivals and verdict, all from training poses.

    chance: p-value of its score on permuted residuals. cv_rms: cross-validated 3-D RMS with it, m; cv_before: without.
    rivals: names and cv_rms of what else it could be. moved: effects of the model, each with the standard deviation of
    its value over these. offered: it was evolved and judged by itself; where it passed, it
    is offered to the selection, which decides.
    """

    candidate: Candidate
    score: Score
    chance: Chance
    cv_rms: float
    cv_before: float
    rivals: tuple[tuple[str, float], ...]
    verdict: Verdict
    offered: bool = False
    moved: tuple[tuple[str, float], ...] = ()

    @property
    def added(self) -> bool:
        """Whether it passed and became a finding."""
        return self.accepted and not self.offered

    @property
    def accepted(self) -> bool:
        """Whether it passed every test."""
        return self.verdict.accepted

    @property
    def p_value(self) -> float:
        """Probability of scoring as well by chance."""
        return self.chance.p

    @property
    def shuffles(self) -> int:
        """How many shuffled residuals its chance was told from."""
        return self.chance.shuffles

    @property
    def why(self) -> str:
        """The reason of the verdict, in words."""
        if self.accepted and self.offered:
            return "passes, offered to the selection"
        chance = wording.chance(self.p_value, self.shuffles, self.chance.of)
        return self.verdict.why or f"removes {100 * self.score.gain:.0f} % of the residual energy, p {chance}"


def judge(
    residual: Residual, candidates: Sequence[Candidate], null_nats: Array, search: Search
) -> tuple[Hypothesis, ...]:
    """The distinct best of what was evolved, best first, each with its verdict; rivals included.

    Candidates whose projected columns correlate above 0.95 are one finding with several possible places. null_nats:
    (T,) the most that any saves on each of T permuted residuals.
    """
    pool = tuple(zip(candidates, scores(residual, candidates), strict=True))
    before = cross_validated(residual, ())
    return tuple(_judged(residual, alike, search, null_nats, before) for alike in _distinct(residual, pool, search))


def every_part_counts(residual: Residual, candidate: Candidate) -> bool:
    """Whether every part of an evolved expression acts at more than a few poses.

    Each of its bases must act at 5 poses and a twentieth of them, and leaving any one out must cost as much
    in cross-validation as is asked of the whole: else a term fitted to a few outlying poses comes in with a true shape.
    """
    criteria, effects = residual.criteria, candidate.effects
    fewest = max(criteria.fewest_poses, criteria.fewest_share * len(residual.poses))
    if residual.poses_at_work(effects).min() < fewest:
        return False
    if len(effects) == 1:
        return True
    rest = (effects[:k] + effects[k + 1 :] for k in range(len(effects)))
    return all(better_by(residual, effects, fewer) > criteria.clear_cv_t for fewer in rest)


def _distinct(residual: Residual, pool: Sequence[Scored], search: Search) -> list[list[Scored]]:
    """The pool's best in groups of alike candidates, each after its leader, the best group first."""
    order = sorted((one for one in pool if np.isfinite(one[1].nats)), key=lambda one: -one[1].nats)
    groups: list[list[Scored]] = []
    leaders: list[Array] = []
    for candidate, score in order[: search.considered]:
        span = ident.orthonormal(residual.projected(candidate.effects)[0])
        alike = (ident.canonical_correlation(span, other) > residual.criteria.likeness for other in leaders)
        like = next((group for group, same in zip(groups, alike, strict=True) if same), None)
        if like is not None:
            like.append((candidate, score))
        elif len(groups) < search.shortlist and every_part_counts(residual, candidate):
            groups.append([(candidate, score)])
            leaders.append(span)
    return groups


def _judged(
    residual: Residual, alike: Sequence[Scored], search: Search, null_nats: Array, before: Predicted
) -> Hypothesis:
    """The verdict on alike candidates, their leader first; before: predictions without any of them."""
    candidate, score = plainest(residual.criteria, alike)
    others = rivals(residual, candidate, alike, search.rivals)
    hypothesis = tested(residual, candidate, score, chance(alike[0][1].nats, null_nats), before, others)
    share, limit = score.share, residual.criteria.minimum_share
    tests = hypothesis.verdict.tests
    verdict = Verdict((*tests, Test("unique share", share, limit, share > limit)))
    return replace(hypothesis, verdict=verdict, offered=True)


def tested(
    residual: Residual, candidate: Candidate, score: Score, by_chance: Chance, before: Predicted,
    others: tuple[tuple[str, float], ...],
) -> Hypothesis:  # fmt: skip
    """A candidate with its verdict: every test of the criteria but that of its unique share, which is for candidates
    that were not chosen beside the model's own columns."""
    criteria = residual.criteria
    after = cross_validated(residual, candidate.effects)
    cv_t = gained(before, after, criteria.outlier_sigmas)
    inflated = inflation(residual, candidate)
    predicts = criteria.minimum_cv_t if candidate.family else criteria.clear_cv_t
    tests = [
        Test("chance", by_chance.p, criteria.significance, by_chance.p < criteria.significance),
        Test("nats", score.nats, criteria.minimum_nats, score.nats > criteria.minimum_nats),
        Test("cross-validation", cv_t, predicts, cv_t > predicts),
    ]
    if order_matters(residual, candidate):
        t = better_by(residual.in_stretches, candidate.effects)
        tests.append(Test("stretches", t, predicts, t > predicts))
    beyond = beyond_a_walk(residual, candidate)
    if beyond is not None:
        tests.append(Test("walk", beyond, 0.0, beyond > 0.0))
    shared = {name: factor for name, factor in inflated.items() if factor > 1.0}
    for name, nats in zip(shared, deflated(residual, candidate, tuple(shared.values())), strict=True):
        tests.append(Test(name, nats, criteria.minimum_nats, nats > criteria.minimum_nats))
    if not candidate.has_priors:
        plain = _sigmas(residual, candidate)
        sigmas = plain / np.sqrt(max(inflated.values(), default=1.0))
        sign = _sign_is_stable(after.coefficients)
        tests += [
            Test("coefficient", sigmas, criteria.minimum_sigmas, sigmas > criteria.minimum_sigmas),
            Test("sign", float(sign), 1.0, sign),
        ]
    return Hypothesis(candidate, score, by_chance, after.rms, before.rms, others, Verdict(tuple(tests)))


def as_searched(hypothesis: Hypothesis, searched: Sequence[Hypothesis]) -> Hypothesis:
    """The hypothesis with its largest p-value: a law that was evolved, by itself or among other terms, and then
    selected went through two searches, and the null of the selection knows nothing of the first."""
    candidate = hypothesis.candidate
    own = {effect.terms for effect in candidate.effects}

    def holds_it(other: Candidate) -> bool:
        among = not candidate.family and own <= {effect.terms for effect in other.effects}
        return among or other.name == candidate.name

    found = [h.chance for h in searched if holds_it(h.candidate)]
    return replace(hypothesis, chance=larger(hypothesis.chance, *found))


def _sigmas(residual: Residual, candidate: Candidate) -> float:
    """The largest coefficient of a candidate in its standard deviations."""
    span, _ = residual.projected(candidate.effects)
    gram = np.linalg.pinv(span.T @ span)
    solved = gram @ (span.T @ residual.values)
    rest = residual.values - span @ solved
    sigma = np.sqrt(rest @ rest / max(residual.freedom - span.shape[1], 1))
    deviation = sigma * np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return float(np.max(np.abs(solved) / deviation))


def _sign_is_stable(coefficients: Array) -> bool:
    """Whether the largest coefficient of a set (folds, E) keeps its sign in every fold."""
    leading = int(np.argmax(np.abs(coefficients.mean(axis=0))))
    signs = np.sign(coefficients[:, leading])
    return bool(np.all(signs == signs[0]))
