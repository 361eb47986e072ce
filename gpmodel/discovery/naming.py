"""Which of several alike candidates speaks for them, and what else a finding could be."""

from collections.abc import Sequence

from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import Score
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression

Scored = tuple[Candidate, Score]


def plainest(criteria: Criteria, alike: Sequence[Scored]) -> Scored:
    """Of alike candidates that save as much as the first, the best, within a nat: the one with the fewest operators."""
    nats = alike[0][1].nats - criteria.tie
    return min((one for one in alike if one[1].nats > nats), key=lambda one: (_operators(one[0]), -one[1].nats))


def rivals(
    residual: Residual, candidate: Candidate, alike: Sequence[Scored], most: int
) -> tuple[tuple[str, float], ...]:
    """What else a finding could be: names and cross-validated RMS, m, of the alike candidates that say it otherwise."""
    shown = [candidate]
    for rival, _ in alike:
        if len(shown) <= most and not any(_restates(rival, other) for other in shown):
            shown.append(rival)
    return tuple((rival.name, cross_validated(residual, rival.effects).rms) for rival in shown[1:])


def _operators(candidate: Candidate) -> int:
    return sum(Expression(str(term.basis)).operators for effect in candidate.effects for term in effect.terms[:1])


def _restates(rival: Candidate, other: Candidate) -> bool:
    """Whether a rival says the same with more words: same place, nothing read less than `other` reads."""
    if rival.name == other.name:
        return True
    shared = set(rival.effects[0].slots) & set(other.effects[0].slots)
    same_place = bool(shared) and rival.place.axis == other.place.axis
    return same_place and set(rival.inputs) >= set(other.inputs)
