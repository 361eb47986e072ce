"""One group in the place of several, and several in the place of one: what no exchange of one for one can do."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from gpmodel.discovery.selection.active import Active
from gpmodel.discovery.selection.moves import SETTLED, found, grown, pruned, reestimated
from gpmodel.discovery.selection.scan import scan

LAW = 2
"""Effects up to which a group is a law itself."""

TRIED = 3
"""Groups tried in the place of several, the best first at the noise as it is."""

LEEWAY = 100.0
"""Nats that re-estimation may bring beyond what a group saves at the variances as they are; it brings tens."""


def merged(active: Active) -> Active:
    """The groups found at each place against the one that does most in their stead, where that raises the evidence.

    Groups that were added one after the other can share what one shape explains by itself, each of them needed beside
    the rest; then none can be exchanged alone.
    """
    for place, several in _together(active).items():
        fewer = active
        for g in several:
            fewer = fewer.without(g)
        groups = active.pool.groups
        others = [h for h, group in enumerate(groups) if group.place == place and h not in active.variances]
        if not others:
            continue
        gains, variances, _ = scan(fewer, np.array(others))
        saved = gains - active.pool.cost
        for h in np.argsort(-saved)[:TRIED]:
            if saved[h] < active.evidence - fewer.evidence - LEEWAY:
                break
            trial = pruned(reestimated(fewer.added(int(h), float(variances[h]))))
            if trial.evidence > active.evidence + SETTLED:
                active = trial
                break
    return active


def spelled_out(active: Active) -> Active:
    """The curves found, each against a law in its inputs and what grows beside that, where it raises the evidence.

    A law that needs another effect beside it loses to a curve that has both in it. One that saves nothing in the place
    of the curve is no trial: what would grow is what grows without it.
    """
    for g in found(active):
        group = active.pool.groups[g]
        if g not in active.variances or len(group.effects) <= LAW:
            continue
        for h in _laws_in(active, group.inputs):
            fewer = pruned(reestimated(active.without(g).added(h, active.variances[g])))
            if h not in fewer.variances:
                continue
            trial = grown(fewer, but={g})
            if trial.evidence > active.evidence + SETTLED:
                active = trial
                break
    return active


def acquitted(active: Active) -> Active:
    """The errors of the instrument that were found, each against what grows of the robot in its stead.

    Where that raises the evidence: one scale comes before the pitches of two screws, and then needs a third to make up
    for it.
    """
    for g in found(active):
        if g in active.variances and active.pool.groups[g].effects[0].of_the_instrument:
            trial = grown(pruned(reestimated(active.without(g))), but={g})
            if trial.evidence > active.evidence + SETTLED:
                active = trial
    return active


def _laws_in(active: Active, inputs: Sequence[str]) -> list[int]:
    """Groups without a name, not in the model, that read nothing else."""
    return [
        h for h, group in enumerate(active.pool.groups)
        if not group.family and not group.standing and h not in active.variances and set(group.inputs) <= set(inputs)
    ]  # fmt: skip


def _together(active: Active) -> dict[str, list[int]]:
    """The groups that were found, by place, where there are several at one."""
    at = defaultdict(list)
    for g in found(active):
        at[active.pool.groups[g].place].append(g)
    return {place: several for place, several in at.items() if len(several) > 1}
