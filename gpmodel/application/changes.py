"""Tests of changes since a model was fitted: each possible change against the residual of the model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.application.possible_changes import Kind, PossibleChange, wander, zero_of
from gpmodel.application.recheck import LEAST_FREEDOM, Recheck
from gpmodel.arrays import NotNegative, Share
from gpmodel.numerics.interval import chance_of_ratio

SET_UP: Kind = "set-up"
SIGNIFICANCE = 0.005
"""Significance of each of the two tests of a valid model, of the whole residual and of named changes: 1 % together."""
MOST = 4
"""Changes named at most: where more would be, nothing is what it was."""
AS_LIKELY = 4.0
"""Difference of chi-square below which another change explains the poses as well: two standard deviations."""
LARGEST = 0.01
"""Radians or metres: a zero that is only seen from there on is not seen."""
POWER = 0.9
"""Chance with which a change is seen that is called visible."""


@dataclass(frozen=True)
class NamedChange:
    """Change of a named quantity, value ± one standard error, in `unit`; of a `size` as a fraction of the model's
    value.

    chance: of so much while nothing changed, corrected for all that was tried. rivals: what explains the poses as well.
    """

    name: str
    kind: Kind
    value: float
    stderr: NotNegative
    unit: str
    chance: Share
    rivals: tuple[str, ...]


@dataclass(frozen=True)
class Visible:
    """The smallest change of a joint's zero, in `unit`, that these poses would show; None where none would, since the
    registration that every session finds anew stands for it."""

    joint: str
    unit: str
    size: NotNegative | None


def changes(
    found: Recheck, tried: Sequence[PossibleChange], significance: float = SIGNIFICANCE
) -> tuple[tuple[NamedChange, ...], Recheck]:
    """Select the significant changes, the least probable first, each given the earlier ones; return the residual
    after them.

    The chance of one is that of its F ratio over its share of the significance (weighted Bonferroni). Where the set-up
    is seen to move along the rows, poses depend on those before: a set-up that wanders is taken out too, and
    what it explains as well as the machine does is laid to it.
    """
    out: list[NamedChange] = []
    left = found
    while tried and len(out) < MOST and left.degrees >= LEAST_FREEDOM:
        here = [h.beside(left) for h in tried]
        scores = [h.explained(left.z) for h in here]
        chances = [_chance(found, *score) / h.share for h, score in zip(here, scores, strict=True)]
        best = min(range(len(here)), key=lambda k: (chances[k], -scores[k][0]))
        if chances[best] >= significance:
            break
        own, numbers = scores[best]
        alike = [k for k, (score, n) in enumerate(scores) if n <= numbers and score > own - AS_LIKELY]
        best = next((k for k in alike if here[k].kind == SET_UP and chances[k] < significance), best)
        chosen, rivals = here[best], tuple(here[k].name for k in alike if k != best)
        size = chosen.fitted(left.z)
        out.append(NamedChange(chosen.name, chosen.kind, *size, chosen.unit, chances[best], rivals[:4]))
        left = left.without(chosen.columns if chosen.kind != SET_UP else np.hstack([chosen.columns, wander(left)]))
    return tuple(out), left


def _chance(found: Recheck, score: float, numbers: int) -> float:
    return chance_of_ratio(score / numbers, numbers, found.freedom) if numbers else 1.0


def visible(found: Recheck, tried: Sequence[PossibleChange], significance: float = SIGNIFICANCE) -> tuple[Visible, ...]:
    """Return the smallest change of each joint zero that these poses detect with the chance POWER."""
    zeros = {h.name: h for h in tried if h.kind == "zero"}
    out = []
    for joint in found.session.saved.mechanism.joints:
        zero, size = zeros.get(zero_of(joint.name)), None
        if zero is not None:
            needed = special.ndtri(POWER) - special.ndtri(0.5 * significance * zero.share)
            least = float(needed / np.linalg.norm(zero.columns))
            size = least if least < LARGEST else None
        out.append(Visible(joint.name, "rad" if joint.kind == "revolute" else "m", size))
    return tuple(out)
