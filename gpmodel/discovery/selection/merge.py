"""One group in the place of several: a move that no exchange of one for one can make."""

from collections import defaultdict

import numpy as np

from gpmodel.discovery.selection.active import Active
from gpmodel.discovery.selection.moves import SETTLED, found, pruned, reestimated
from gpmodel.discovery.selection.scan import scan

TRIED = 3
"""Groups tried in the place of several, the best first at the noise as it is."""


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
        for h in np.argsort(active.pool.cost - gains)[:TRIED]:
            trial = pruned(reestimated(fewer.added(int(h), float(variances[h]))))
            if trial.evidence > active.evidence + SETTLED:
                active = trial
                break
    return active


def _together(active: Active) -> dict[str, list[int]]:
    """The groups that were found, by place, where there are several at one."""
    at = defaultdict(list)
    for g in found(active):
        at[active.pool.groups[g].place].append(g)
    return {place: several for place, several in at.items() if len(several) > 1}
