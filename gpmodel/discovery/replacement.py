"""A finding may stand in for one that fits better by now, or for two that act together: what says it better."""

from collections.abc import Mapping, Sequence

import numpy as np

from gpmodel.arrays import Array
from gpmodel.discovery.acceptance import Hypothesis, judge, worth
from gpmodel.discovery.cross_validation import better_by
from gpmodel.discovery.pool import pool_of
from gpmodel.discovery.residual import Residual
from gpmodel.discovery.score import scores
from gpmodel.discovery.search import Search
from gpmodel.families.candidate import Candidate


def better(
    without: Residual, finding: Candidate, pool: Sequence[Candidate], nulls: Mapping[str, Array], search: Search
) -> tuple[Hypothesis, ...]:
    """The one or two candidates that should replace a finding; none where it should stay.

    Forward selection takes the best single effect first; where two act, that may be a third that resembles both.
    Beside the finding alone, and the finding with the best of the pool beside it, they must save 5 nats more (named
    effects have a head start) and not predict worse in cross-validation; and each must pass every test of a finding.
    Source: floating search, Pudil, Novovičová and Kittler (1994).

    without: the residual with the finding's part given back to it. nulls: as of `Pool`.
    """
    if finding.has_priors:
        return ()
    plain = [c for c in pool if c.name != finding.name and not c.has_priors]
    nats = _nats(without, plain)
    promising = [plain[i] for i in np.argsort(-nats)[: search.exchange_pool] if np.isfinite(nats[i])]
    if not promising:
        return ()
    beside = _best(without.beside(finding.effects), promising)

    def judged(residual: Residual) -> Hypothesis:
        return judge(residual, pool_of(residual, promising, nulls), search)[0]

    kept = ((finding,), (finding, beside))
    pairs = [
        _settled(without, first, promising, search.exchange_turns) for first in promising[: search.exchange_starts]
    ]
    first, second = pairs[int(np.argmax(_nats(without, [_together(pair) for pair in pairs])))]
    if all(_outdoes(without, (first, second), holder) for holder in kept):
        found = tuple(judged(without.beside(other.effects)) for other in (second, first))
        if all(h.accepted for h in found):
            return found
    if all(_outdoes(without, promising[:1], holder) for holder in kept):
        single = judged(without)
        return (single,) if single.accepted else ()
    return ()


def _nats(residual: Residual, pool: Sequence[Candidate]) -> Array:
    return np.array([score.nats for score in scores(residual, pool)])


def _best(residual: Residual, pool: Sequence[Candidate]) -> Candidate:
    return pool[int(np.argmax(_nats(residual, pool)))]


def _together(members: Sequence[Candidate]) -> Candidate:
    return Candidate("", tuple(e for c in members for e in c.effects), "", sum(c.cost for c in members))


def _outdoes(residual: Residual, challengers: Sequence[Candidate], holders: Sequence[Candidate]) -> bool:
    """Whether they save 5 nats more, named effects ahead, and do not predict worse by 2 deviations, pose by pose."""
    criteria = residual.criteria
    new, old = _together(challengers), _together(holders)
    new_nats, old_nats = _nats(residual, [new, old])
    if worth(criteria, new_nats, *challengers) < worth(criteria, old_nats, *holders) + criteria.minimum_nats:
        return False
    return better_by(residual, new.effects, old.effects) > -criteria.minimum_cv_t


def _settled(
    residual: Residual, first: Candidate, pool: Sequence[Candidate], turns: int
) -> tuple[Candidate, Candidate]:
    """The pair that alternation from `first` ends at: each is the best of the pool beside the other."""
    second = first
    for _ in range(turns):
        best = _best(residual.beside(first.effects), pool)
        if best is second:
            break
        first, second = best, first
    return first, second
