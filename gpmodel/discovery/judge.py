"""The verdicts on the best of what was evolved: alike candidates are one finding, said by the plainest of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.discovery.acceptance import Hypothesis, tested
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import Predicted, better_by, cross_validated
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import Score, scores
from gpmodel.evolution.chance import chance
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.numerics import rank as ident

Scored = tuple[Candidate, Score]


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
    hypothesis = tested(residual, candidate, score, chance(alike[0][1].nats, null_nats), before)
    return replace(hypothesis, rivals=rivals(residual, candidate, alike, search.rivals), offered=True)


def plainest(criteria: Criteria, alike: Sequence[Scored]) -> Scored:
    """Of alike candidates that save as much as the first, the best, within a nat: the shortest to read."""
    nats = alike[0][1].nats - criteria.tie
    return min((one for one in alike if one[1].nats > nats), key=lambda one: (_length(one[0]), -one[1].nats))


def rivals(
    residual: Residual, candidate: Candidate, alike: Sequence[Scored], most: int
) -> tuple[tuple[str, float], ...]:
    """What else a finding could be: names and cross-validated RMS, m, of the alike candidates that say it otherwise."""
    shown = [candidate]
    for rival, _ in alike:
        if len(shown) <= most and not any(_restates(rival, other) for other in shown):
            shown.append(rival)
    return tuple((rival.name, cross_validated(residual, rival.effects).rms) for rival in shown[1:])


def _length(candidate: Candidate) -> int:
    return sum(Expression(str(term.basis)).length for effect in candidate.effects for term in effect.terms[:1])


def _restates(rival: Candidate, other: Candidate) -> bool:
    """Whether a rival says the same with more words: same place, nothing read less than `other` reads."""
    if rival.name == other.name:
        return True
    shared = set(rival.effects[0].slots) & set(other.effects[0].slots)
    same_place = bool(shared) and rival.place.axis == other.place.axis
    return same_place and set(rival.inputs) >= set(other.inputs)
