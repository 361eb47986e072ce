"""Moves that replace several groups by one, or one by several, where no exchange of one for one raises the evidence."""

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from gpmodel.selection.active import Active
from gpmodel.selection.group import Group
from gpmodel.selection.moves import (
    backward_eliminated,
    first_better,
    forward_selected,
    found,
    parts_left,
    with_optimal_variances,
)
from gpmodel.selection.scan import scan

LAW = 2
"""Effects up to which a group is a law itself."""

TRIED = 3
"""Groups tried in the place of several, the best first at the noise as it is."""

PAIRED = 30
"""Groups of which two are tried in the place of one, the best first."""

LEEWAY = 50.0
"""Nats by which a trial falls short at the variances as they are, and is none: re-estimation brings half of them."""


def merged(active: Active) -> Active:
    """Replace the groups at each place by the one that gains most without them, keep that if the evidence rises.

    Groups that were added one after the other can share what one shape explains by itself, each of them needed beside
    the rest; then none can be exchanged alone.
    """
    for place, several in _together(active).items():
        active = first_better(active, _by_one(active, place, several))
    return active


def _by_one(active: Active, place: str, several: Sequence[int]) -> Iterator[Active]:
    """The model with one group at a place instead of several, the best first."""
    fewer = active
    for g in several:
        fewer = fewer.without(g)
    others = [h for h, group in enumerate(active.pool.groups) if group.where == place and h not in active.variances]
    if not others:
        return
    gains, variances, _ = scan(fewer, np.array(others))
    saved = gains - active.pool.cost
    for h in np.argsort(-saved)[:TRIED]:
        if saved[h] < active.evidence - fewer.evidence - LEEWAY:
            return
        yield backward_eliminated(with_optimal_variances(fewer.added(int(h), float(variances[h]))))


def curves_to_laws(active: Active) -> Active:
    """Replace each curve by a law in its inputs and regrow, keep that if the evidence rises.

    A law that needs another effect beside it loses to a curve that has both in it.
    """
    for g in found(active):
        if g in active.variances and len(active.pool.groups[g].effects) > LAW:
            active = first_better(active, _by_laws(active, g))
    return active


def _by_laws(active: Active, g: int) -> Iterator[Active]:
    """The model with a law instead of a curve, regrown. One that saves nothing in the place of the curve is no trial:
    what would grow is what grows without it."""
    for h in _laws_in(active, active.pool.groups[g]):
        fewer = backward_eliminated(with_optimal_variances(active.without(g).added(h, active.variances[g])))
        if h in fewer.variances:
            yield forward_selected(fewer, but={g})


def replace_catch_alls(active: Active) -> Active:
    """Drop each catch-all group, regrow, keep that if the evidence rises.

    An error of the instrument is as large everywhere, one scale comes before the
    pitches of two screws and then needs a third to make up for it; and the weights of all links beyond a joint, each
    by itself, say what a tilting base and a wave of the joint's own angle do together, none of which comes first alone.
    """
    for g in found(active):
        if g in active.variances and _broad(active.pool.groups[g]):
            fewer = backward_eliminated(with_optimal_variances(active.without(g)))
            grown = [forward_selected(start, but={g}) for start in (fewer, _with_two(fewer, g))]
            active = first_better(active, [max(grown, key=lambda trial: trial.evidence)])
    return active


def _broad(group: Group) -> bool:
    """Whether a group is a catch-all: of the instrument, or at one place with an unknown for each of several inputs."""
    several = not group.parts and len(group.inputs) >= len(group.effects) > LAW
    return several or group.effects[0].of_the_instrument


def _with_two(active: Active, but: int) -> Active:
    """With the two groups but one that do most together, of those that do most alone."""
    cost = active.pool.cost
    gains, variances, _ = scan(active)
    gains = gains - cost
    gains[[*active.variances, but]] = -np.inf
    among = np.argsort(-gains)[: min(PAIRED, int(np.isfinite(gains).sum()))]
    pairs: dict[tuple[int, ...], tuple[float, Active]] = {}
    for h in among.tolist():
        one = active.added(h, float(variances[h]))
        saved, sizes, _ = scan(one, among)
        saved = saved + gains[h] - cost
        saved[list(one.variances)] = -np.inf
        for other in np.argsort(-saved)[: min(TRIED, int(np.isfinite(saved).sum()))].tolist():
            pairs[tuple(sorted((h, other)))] = saved[other], one.added(other, float(sizes[other]))
    likely = sorted(pairs.values(), key=lambda pair: -pair[0])[: PAIRED // TRIED]
    return max((with_optimal_variances(pair) for _, pair in likely), key=lambda trial: trial.evidence, default=active)


def _laws_in(active: Active, curve: Group) -> list[int]:
    """Groups without a name, not in the model, that read nothing else; free functions of fewer inputs at its place."""
    inputs = set(curve.inputs)

    def may_stand(group: Group) -> bool:
        free = group.found_by == "surface"
        return set(group.inputs) <= inputs and not (
            free and (group.where != curve.where or set(group.inputs) == inputs)
        )

    groups = active.pool.groups
    unnamed = (h for h, group in enumerate(groups) if not group.family and not group.always_included)
    return [h for h in unnamed if h not in active.variances and may_stand(groups[h])]


def _together(active: Active) -> dict[str, list[int]]:
    """The groups that were found, by place, where there are several at one."""
    at = defaultdict(list)
    for g in found(active):
        at[_place(active, g)].append(g)
    return {place: several for place, several in at.items() if len(several) > 1}


def _place(active: Active, g: int) -> str:
    """Where a group acts; of one of several places, of which but one is left, that one."""
    group = active.pool.groups[g]
    left = {group.parts[part].where for part in parts_left(active, g)} if group.parts else {group.where}
    return left.pop() if len(left) == 1 else group.where
