"""Curves in more detail than they are chosen with."""

from collections.abc import Mapping
from dataclasses import replace

from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.curves import continued


def detailed(left: Residual, found: Mapping[str, Candidate]) -> dict[str, Candidate]:
    """What was found, a fine curve with twice its harmonics where the new ones save description length.

    A drive has lines up to twice its reduction ratio; that its curve is there, fewer tell in an eighth of the time.
    left: what a model with all that was found leaves.
    """
    out = dict(found)
    for name, candidate in found.items():
        more = continued(candidate)
        if 2 * len(more) <= len(left.poses) and more:
            new = Candidate(name, more, candidate.family, 0.0)
            if scores(left, [new])[0].nats > left.criteria.minimum_nats:
                out[name] = replace(candidate, effects=(*candidate.effects, *more))
    return out
