"""Detect a curve with few harmonics, double them if that saves nats."""

from collections.abc import Mapping
from dataclasses import replace

from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.curves import continued


def detailed(left: Residual, found: Mapping[str, Candidate]) -> dict[str, Candidate]:
    """The findings, fine curves with twice their harmonics where the new ones lower the description length.

    A drive has lines up to twice its reduction ratio; half as many harmonics detect its curve in an eighth of the time.
    left: the residual of a model with all findings.
    """
    out = dict(found)
    for name, candidate in found.items():
        more = continued(candidate)
        if 2 * len(more) <= len(left.poses) and more:
            new = Candidate(name, more, candidate.family, 0.0)
            if scores(left, [new])[0].nats > left.criteria.minimum_nats:
                out[name] = replace(candidate, effects=(*candidate.effects, *more))
    return out
