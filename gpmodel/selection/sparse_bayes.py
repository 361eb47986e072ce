"""Sparse Bayesian learning over groups of effects: add, delete, re-estimate, and one exchange move.

    y = Σ_g X_g u_g + e,   u_g ~ N(0, a_g I),   e ~ N(0, σ² I)
    L = ln p(y | a, σ²) - Σ_g price_g over the groups that are not always included        [nats]

X_g are the columns of group g, u_g its coefficients, a_g their prior variance. `grow` increases L by adding single
groups. If two groups together describe an effect that a third describes alone, no single step leads from one model to
the other: `exchange` removes groups, forbids them, and grows the model again. Models are compared by their utility: L
minus the prices of smooth terms and formulas that are hard to read. Thus a formula that explains nearly
as much replaces a smooth term. Sources: Tipping and Faul (2003), MacKay (1992); tabu: Glover (1989).
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from functools import reduce

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.evidence.score import with_refitted_noise
from gpmodel.selection.group import FEW
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.posterior import LEAST_NOISE, Active
from gpmodel.selection.scan import Scan, beside_curves, whole

TOLERANCE = 0.05
"""Rise of the objective (log evidence minus penalties), nats, below which a loop of the selection ends."""
SWEEPS = 30
"""Largest number of re-estimations of the prior variances; far fewer are usual."""
FREE = 1e4
"""Factor on the prior variance of a group of few coefficients, with which the prior has no influence."""
SHORT_LIST = 100
"""Number of best groups of a full scan that are scored again, until no group of the list has a net gain."""
TOGETHER, BEGIN, GO_ON = 3, 0.05, 0.33
"""TOGETHER: number of best groups whose gains must reach shares BEGIN, then GO_ON, of the utility lost by a removal.
Two groups that share nothing gain little until the first is in the model and reduces the noise: a twentieth of the loss
(a hinge by a line and a ramp, 12 %), then more than half. A limit of a third ends two of three exchanges on a robot.
"""


def exchange(model: Active, new: frozenset[str] | None = None) -> Active:
    """Maximise the utility over all candidate groups by exchanges, after growing the model.

    Removals that failed on an earlier model are tried last, until no removal improves the model. In a trial exchange,
    groups of many coefficients keep their prior variances; a better model is grown in full. new: names of the groups
    of which one begins every regrowth, if all other groups were tried before; None for all groups.
    """
    model, tried, pools = named_by_site(grow(model)), dict[frozenset[int], int](), dict[frozenset[int], GroupPool]()
    first = np.array([new is None or group.name in new for group in model.pool.groups])
    waiting = _removals(model)
    while waiting:
        tried[removed := waiting.pop(0)] = len(tried)
        here = reestimate(beside_curves(model, removed, pools))
        for trial in _exchanged(here, removed, first):
            if trial.utility > here.utility + TOLERANCE:
                full = whole(trial)
                better = max(named_by_site(grow(full, reading=True)), full, key=lambda one: one.utility)
                if better.utility > model.utility + TOLERANCE:
                    model, waiting = better, sorted(_removals(better), key=lambda those: tried.get(those, -1))
                    break
    return model


def grow(model: Active, listed: IntArray | None = None, reading: bool = False, goal: float = -np.inf) -> Active:
    """Add the group of largest net gain, re-estimate, and prune the model, until no candidate has a net gain.

    listed: groups that may be added; None for all groups. reading: whether to include the extra penalties of smooth
    terms and long formulas. goal: utility to reach, nats; growth ends if the best groups cannot reach the goal.
    """
    model = prune(reestimate(model))
    refused, among = set[int](), listed
    while True:
        price = model.prices + reading * model.pool.reading
        gains, variances, fit = Scan(model, among).gains(price)
        net = gains - price
        net[[*model.variances, *refused]] = -np.inf
        if net.max() < 0.0:
            net = with_refitted_noise(net, fit, model.mismatch)
        g = int(np.argmax(net))
        if _together(with_refitted_noise(net, fit, model.mismatch)) < GO_ON * (goal - model.utility):
            return model
        if not net[g] > 0.0:
            if among is listed:
                return model
            among = None
            continue
        if among is None:
            among = np.argsort(-net)[:SHORT_LIST]
        trial = prune(reestimate(model.added(g, float(variances[g])), 4))
        if (
            trial.objective > model.objective + TOLERANCE
            and g in trial.variances
            and not model.criteria.rests_on_one_pose(model.misfit * (model.sigma2 / trial.sigma2) - trial.misfit)
        ):
            model = trial
        else:
            refused.add(g)


def _removals(model: Active) -> list[frozenset[int]]:
    """Return the sets of groups to remove: each group, the weakest first, all groups at one site, all of one kind."""
    pool, together = model.pool, defaultdict[object, set[int]](set)
    for g in model.found:
        group = pool.groups[g]
        sites = {group.parts[part].where for part in model.part_of_column(g)} if group.parts else {group.where}
        together[sites.pop() if len(sites) == 1 else group.where].add(g)
        together[int(pool.block[g]) if pool.block[g] >= 0 else group.name].add(g)
    alone = [frozenset({g}) for g in sorted(model.found, key=model.net_gain)]
    return [*alone, *(frozenset(several) for several in together.values() if len(several) > 1)]


def _exchanged(model: Active, removed: frozenset[int], first: Mask) -> Iterator[Active]:
    """Yield models that are grown again after the groups `removed` are forbidden.

    Growth begins with the group of largest net gain among `first`, with free variances of the remaining groups, since a
    group of fixed variance excludes groups that would change the variance. Growth continues among the best SHORT_LIST
    groups. One group may approximate two effects well: new groups that gain more than half of the lost utility are
    excluded from a second growth. Groups of few coefficients alone are tried in the place of a group of many.
    """
    pool, fewer = model.pool, reestimate(reduce(Active.without, removed, model), 4)
    lost = model.utility - fewer.utility
    if lost < 0.0:
        yield fewer
    small = {g for g in fewer.found if pool.sizes[g] <= FEW}
    free = replace(fewer, variances={g: a * FREE if g in small else a for g, a in fewer.variances.items()})
    gains, variances, fit = Scan(free).gains(fewer.prices + pool.reading)
    net = with_refitted_noise(gains - fewer.prices - pool.reading, fit, free.mismatch)
    net[[*fewer.variances, *_forbidden(pool, removed)]] = -np.inf

    def regrown(net: Array, begin: Array) -> Active | None:
        best = int(np.argmax(begin))
        if not (begin[best] > 0.0 and _together(begin) > BEGIN * lost):
            return None
        listed = np.argsort(-net)[:SHORT_LIST]
        listed = listed[net[listed] > -np.inf]
        return named_by_site(grow(free.added(best, float(variances[best])), listed, True, model.utility))

    begin = np.where(first, net, -np.inf)
    grown = regrown(net, begin)
    if grown is None:
        return
    yield grown
    came = frozenset(grown.variances) - frozenset(model.variances)
    if came and grown.utility - fewer.utility > model.utility - grown.utility:
        again = net.copy()
        again[_forbidden(pool, came)] = -np.inf
        if (other := regrown(again, again)) is not None:
            yield other
    if (pool.sizes[list(removed)] > FEW).any():
        many = np.where(pool.sizes > FEW, np.inf, 0.0)
        if (plain := regrown(net - many, begin - many)) is not None:
            yield plain


def reestimate(model: Active, sweeps: int = SWEEPS) -> Active:
    """Update the logarithms of prior variances and noise, with half the step if the log evidence falls."""
    step = 1.0
    for _ in range(sweeps):
        target = model.reestimated
        sigma2 = max(model.energy / max(model.pool.rows.freedom - model.unknowns, 1.0), LEAST_NOISE**2)
        moved = {g: a * (target[g] / a) ** step for g, a in model.variances.items()}
        trial = replace(model, variances=moved, sigma2=model.sigma2 * (sigma2 / model.sigma2) ** step)
        gained = trial.evidence - model.evidence
        if gained < -1e-9:
            step *= 0.5
            if step < 0.05:
                return model
            continue
        model, step = trial, min(1.0, 1.5 * step)
        if gained < TOLERANCE:
            return model
    return model


def prune(model: Active, exempt: int = -1) -> Active:
    """Delete groups with a net loss except `exempt`, the worst first, and the sites of joint groups without gain."""
    while (
        worst := min((g for g in model.found if g != exempt), key=model.net_gain, default=None)
    ) is not None and model.net_gain(worst) < 0.0:
        model = reestimate(model.without(worst), 3)
    return _without_idle_sites(model)


def named_by_site(model: Active) -> Active:
    """Replace a group of several sites by one group per site if more than half of the sites have a net gain.

    Models are compared after the split, so that each site has its penalty. Sites without a net gain are deleted.
    """
    blocks = [g for g in model.found if model.pool.groups[g].parts]
    number = {group.name: g for g, group in enumerate(model.pool.groups)} if blocks else {}
    for g in blocks:
        parts, trial = model.pool.groups[g].parts, model.without(g)
        for part in np.unique(model.part_of_column(g)):
            trial = trial.added(number[parts[part].name], model.variances[g] / len(parts))
        trial = reestimate(trial)
        strong = [trial.net_gain(h) >= 0.0 for h in trial.variances if h not in model.variances]
        if 2 * sum(strong) > len(strong):
            model = prune(trial)
    return model


def _together(net: Array) -> float:
    """Return the sum of the largest net gains of groups of effects, nats; `TOGETHER` is the number of summands."""
    return float(np.sort(net)[-TOGETHER:].clip(0.0).sum())


def _forbidden(pool: GroupPool, removed: frozenset[int]) -> list[int]:
    """Return the removed groups, and each joint group of which only one part was removed, by number."""
    kinds = pool.block[list(removed)]
    return [*removed, *pool.wholes[np.flatnonzero(np.bincount(kinds[kinds >= 0]) == 1)].tolist()]


def _without_idle_sites(model: Active) -> Active:
    """Delete from joint groups each site that gains too little at the variance common to all sites of the group."""
    for g in list(model.variances):
        of_column = model.part_of_column(g)
        for part in np.unique(of_column)[::-1]:
            mine = np.flatnonzero(of_column == part)
            if len(mine) == len(of_column):
                break
            s, q = model.own(g, mine)
            a = model.variances[g]
            if 0.5 * float(np.sum(a * q**2 / (1 + a * s) - np.log1p(a * s))) < model.price_of_site(g):
                left = of_column != part
                model = replace(model, chosen={**model.chosen, g: model.chosen[g][left]})
                of_column = of_column[left]
    return model
