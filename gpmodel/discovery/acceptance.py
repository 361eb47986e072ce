"""From a pool of candidates to one hypothesis: what fits, what it would be, and what else it could be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel import wording
from gpmodel.arrays import Array
from gpmodel.discovery.criteria import Criteria, Test, Verdict
from gpmodel.discovery.residual import Evidence, Score, deviations
from gpmodel.discovery.search import Search
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.numerics import rank as ident
from gpmodel.numerics.null_distribution import chance
from gpmodel.numerics.rank import canonical_correlation


@dataclass(frozen=True)
class Hypothesis:
    """A candidate with what speaks for and against it, all from training poses.

    cv_rms: m, cross-validated 3-D RMS with it; cv_before: without. rivals: names and cv_rms of what else it could be.
    """

    candidate: Candidate
    score: Score
    p_value: float
    cv_rms: float
    cv_before: float
    rivals: tuple[tuple[str, float], ...]
    verdict: Verdict

    @property
    def accepted(self) -> bool:
        return self.verdict.accepted

    @property
    def why(self) -> str:
        """The reason of the verdict, in words."""
        gained = f"removes {100 * self.score.gain:.0f} % of the residual energy, p {wording.chance(self.p_value)}"
        return self.verdict.why or gained


@dataclass(frozen=True)
class Pool:
    """Candidates of one round, their scores, and the null maxima of where each came from."""

    candidates: tuple[Candidate, ...]
    scores: tuple[Score, ...]
    nulls: dict[str, Array]

    def p_value(self, i: int) -> float:
        """Chance of the score among shuffled residuals, times the number of searches that competed."""
        null = self.nulls[self.candidates[i].found_by]
        return min(1.0, len(self.nulls) * chance(self.scores[i].nats, null))


def judge(evidence: Evidence, pool: Pool, criteria: Criteria, search: Search) -> tuple[Hypothesis, ...]:
    """The distinct best candidates, best first, each with its verdict; naming and rivals included.

    Candidates whose projected columns correlate above 0.95 are one finding with several possible places. An expression
    that nobody named has to save 5 nats more than a named effect to come before it.
    """
    order = sorted(range(len(pool.scores)), key=lambda i: -worth(criteria, pool.scores[i].nats, pool.candidates[i]))
    order = [i for i in order if np.isfinite(pool.scores[i].nats)]
    named = [i for i in order if pool.candidates[i].family][: search.considered]
    unnamed = [i for i in order if not pool.candidates[i].family][: search.considered]
    looked_at = {*named, *unnamed}
    order = [i for i in order if i in looked_at]
    spans = {i: ident.orthonormal(evidence.projected(pool.candidates[i].effects)[0]) for i in order}
    leaders: list[int] = []
    followers: dict[int, list[int]] = {}
    for i in order:
        leader = next((k for k in leaders if _alike(criteria, spans[i], spans[k])), None)
        of_its_kind = sum((k in named) is (i in named) for k in leaders)
        if leader is None and (of_its_kind >= search.shortlist or not sound(criteria, evidence, pool.candidates[i])):
            continue
        if leader is None:
            leaders.append(i)
            followers[i] = []
        else:
            followers[leader].append(i)
    before, per_pose, _ = evidence.cross_validated(())
    judged = [_judged(evidence, pool, criteria, search, (i, *followers[i]), (before, per_pose)) for i in leaders]
    best = _preferred(criteria, evidence, judged)
    return tuple(replace(h, verdict=h.verdict.deferred()) if h.accepted and h is not best else h for h in judged)


def _preferred(criteria: Criteria, evidence: Evidence, judged: Sequence[Hypothesis]) -> Hypothesis | None:
    """The first that passed; a named one that passed before an expression that does not predict better by 2 deviations.

    What an expression explains beyond a named effect may be a few bad poses, which it has more ways to meet.
    """
    passed = [h for h in judged if h.accepted]
    first = next(iter(passed), None)
    named = next((h for h in passed if h.candidate.family), None)
    if first is None or named is None or first is named:
        return first
    better = evidence.better_by(first.candidate.effects, named.candidate.effects) > criteria.minimum_cv_t
    return first if better else named


def worth(criteria: Criteria, nats: float, *candidates: Candidate) -> float:
    """Description length saved, less the head start of named effects for every one of the candidates without a name."""
    return nats - criteria.head_start * sum(not candidate.family for candidate in candidates)


def sound(criteria: Criteria, evidence: Evidence, candidate: Candidate) -> bool:
    """Whether every part of an expression without a name speaks for more than a few poses.

    Each of its bases must act at 5 poses and a twentieth of them, and leaving any one out must cost 2 deviations in
    cross-validation: else a spike at the worst poses rides along with a shape that is there.
    """
    if candidate.family:
        return True
    effects = candidate.effects
    if evidence.poses_at_work(effects).min() < max(criteria.fewest_poses, criteria.fewest_share * len(evidence.poses)):
        return False
    if len(effects) == 1:
        return True
    whole = evidence.cross_validated(effects)[1]
    rest = (effects[:k] + effects[k + 1 :] for k in range(len(effects)))
    return all(deviations(evidence.cross_validated(fewer)[1] - whole) > criteria.minimum_cv_t for fewer in rest)


def _alike(criteria: Criteria, first: Array, second: Array) -> bool:
    return canonical_correlation(first, second) > criteria.likeness


def _named(criteria: Criteria, pool: Pool, leader: int, alike: Sequence[int]) -> tuple[int, Candidate]:
    """The catalogue's word for an evolved finding where one fits as well; and where GP found it too, that it did.

    Of expressions that save as much, within a nat, the one with the fewest operators speaks for them.
    """
    best = pool.candidates[leader]
    group = [leader, *alike]
    if best.found_by == "evolved":
        named = [i for i in alike if pool.candidates[i].family and pool.candidates[i].found_by == "catalogue"]
        for i in named:
            if pool.scores[i].nats > pool.scores[leader].nats - criteria.naming_margin:
                return i, replace(pool.candidates[i], found_by="evolved")
        ties = [
            i
            for i in group
            if pool.scores[i].nats > pool.scores[leader].nats - criteria.tie and not pool.candidates[i].family
        ]
        plainest = min(ties, key=lambda i: (_operators(pool.candidates[i]), -pool.scores[i].nats))
        return plainest, pool.candidates[plainest]
    evolved = any(pool.candidates[i].found_by == "evolved" for i in group)
    return leader, replace(best, found_by="evolved" if evolved else "catalogue")


def _operators(candidate: Candidate) -> int:
    return sum(Expression(str(effect.terms[0].basis)).operators for effect in candidate.effects)


def _restates(rival: Candidate, other: Candidate) -> bool:
    """Whether an evolved rival says the same with more words: same place, nothing read less than `other` reads."""
    if rival.name == other.name:
        return True
    first, second = rival.effects[0], other.effects[0]
    reads = {x for e in rival.effects for x in e.inputs}
    same_place = set(first.slots) & set(second.slots) and first.terms[0].axis == second.terms[0].axis
    return rival.found_by == "evolved" and bool(same_place) and reads >= {x for e in other.effects for x in e.inputs}


def _judged(
    evidence: Evidence, pool: Pool, criteria: Criteria, search: Search, group: Sequence[int],
    without: tuple[float, Array],
) -> Hypothesis:  # fmt: skip
    """The verdict on a group of alike candidates, its leader first; without: cross-validation without any of them."""
    leader, *alike = group
    chosen, candidate = _named(criteria, pool, leader, alike)
    score, p_value = pool.scores[chosen], pool.p_value(leader)
    cv_rms, after, coefficients = evidence.cross_validated(candidate.effects)
    cv_t = deviations(without[1] - after)
    tests = [
        Test("chance", p_value, criteria.significance, p_value < criteria.significance),
        Test("nats", score.nats, criteria.minimum_nats, score.nats > criteria.minimum_nats),
        Test("cross-validation", cv_t, criteria.minimum_cv_t, cv_t > criteria.minimum_cv_t),
    ]
    if not np.isfinite(candidate.effects[0].prior):
        sigmas, sign = _sigmas(evidence, candidate), _stable(coefficients)
        tests += [
            Test("coefficient", sigmas, criteria.minimum_sigmas, sigmas > criteria.minimum_sigmas),
            Test("sign", float(sign), 1.0, sign),
            Test("unique share", score.share, criteria.minimum_share, score.share > criteria.minimum_share),
        ]
    rivals = _rivals(evidence, pool, candidate, group, search.rivals)
    return Hypothesis(candidate, score, p_value, cv_rms, without[0], rivals, Verdict(tuple(tests)))


def _rivals(
    evidence: Evidence, pool: Pool, candidate: Candidate, group: Sequence[int], most: int
) -> tuple[tuple[str, float], ...]:
    """What else a finding could be: names and cross-validated RMS, m."""
    rivals: list[tuple[str, float]] = []
    shown = [candidate]
    for i in sorted(group, key=lambda k: (pool.candidates[k].found_by, -pool.scores[k].nats)):
        rival = pool.candidates[i]
        if len(rivals) < most and not any(_restates(rival, other) for other in shown):
            shown.append(rival)
            rivals.append((rival.name, evidence.cross_validated(rival.effects)[0]))
    return tuple(rivals)


def _sigmas(evidence: Evidence, candidate: Candidate) -> float:
    span, _ = evidence.projected(candidate.effects)
    gram = np.linalg.pinv(span.T @ span)
    solved = gram @ (span.T @ evidence.residual)
    rest = evidence.residual - span @ solved
    sigma = np.sqrt(rest @ rest / max(evidence.freedom - span.shape[1], 1))
    deviation = sigma * np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return float(np.max(np.abs(solved) / deviation))


def _stable(coefficients: Array) -> bool:
    """Whether the largest coefficient of a set keeps its sign in every fold."""
    leading = int(np.argmax(np.abs(coefficients.mean(axis=0))))
    signs = np.sign(coefficients[:, leading])
    return bool(np.all(signs == signs[0]))
