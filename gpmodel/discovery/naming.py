"""What a finding is called, and what else it could be."""

from collections.abc import Sequence
from dataclasses import replace

from gpmodel.discovery.pool import Pool
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression


def named(criteria: Criteria, pool: Pool, group: Sequence[int]) -> tuple[int, Candidate]:
    """Which of a group of alike candidates, the best first, speaks for it, and the candidate with how it was found.

    The catalogue's word for an evolved finding where one fits as well; and where GP found it too, that it did. Of
    expressions that save as much, within a nat, the one with the fewest operators speaks for them.
    """
    leader = group[0]
    best, nats = pool.candidates[leader], pool.scores[leader].nats
    if best.found_by != "evolved":
        evolved = any(pool.candidates[i].found_by == "evolved" for i in group)
        return leader, replace(best, found_by="evolved" if evolved else "catalogue")
    for i in group[1:]:
        word = pool.candidates[i]
        of_the_catalogue = word.family and word.found_by == "catalogue"
        if of_the_catalogue and pool.scores[i].nats > nats - criteria.naming_margin:
            return i, replace(word, found_by="evolved")
    ties = [i for i in group if pool.scores[i].nats > nats - criteria.tie and not pool.candidates[i].family]
    plainest = min(ties, key=lambda i: (_operators(pool.candidates[i]), -pool.scores[i].nats))
    return plainest, pool.candidates[plainest]


def rivals(
    residual: Residual, pool: Pool, candidate: Candidate, group: Sequence[int], most: int
) -> tuple[tuple[str, float], ...]:
    """What else a finding could be: names and cross-validated RMS, m, of the alike candidates that say it otherwise."""
    out: list[tuple[str, float]] = []
    shown = [candidate]
    for i in sorted(group, key=lambda k: (pool.candidates[k].found_by, -pool.scores[k].nats)):
        rival = pool.candidates[i]
        if len(out) < most and not any(_restates(rival, other) for other in shown):
            shown.append(rival)
            out.append((rival.name, cross_validated(residual, rival.effects).rms))
    return tuple(out)


def _operators(candidate: Candidate) -> int:
    return sum(Expression(str(term.basis)).operators for effect in candidate.effects for term in effect.terms[:1])


def _restates(rival: Candidate, other: Candidate) -> bool:
    """Whether an evolved rival says the same with more words: same place, nothing read less than `other` reads."""
    if rival.name == other.name:
        return True
    shared = set(rival.effects[0].slots) & set(other.effects[0].slots)
    same_place = bool(shared) and rival.place.axis == other.place.axis
    return rival.found_by == "evolved" and same_place and set(rival.inputs) >= set(other.inputs)
