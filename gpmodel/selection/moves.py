"""Moves of the selection: re-estimate, prune, add, split; each raises the evidence, until none does."""

from collections.abc import Iterable, Set
from dataclasses import replace

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.evidence.gain import with_own_noise
from gpmodel.selection.active import LEAST_NOISE, Active
from gpmodel.selection.scan import scan

SETTLED = 0.05
"""Nats: a smaller gain ends the re-estimation, and no group is swapped for one."""
SWEEPS, MOST_MOVES = 30, 200
"""Re-estimations and additions at most; each ends by itself far earlier."""
SHORT_LIST = 100
"""Groups that are looked at again after a full scan, until none of them is worth adding."""


def with_optimal_variances(active: Active, sweeps: int = SWEEPS) -> Active:
    """The model with optimal variances and noise: all at once in log a, halving the step where the evidence falls."""
    step = 1.0
    for _ in range(sweeps):
        target = {g: variance for g, (_, variance) in active.gains.items()}
        sigma2 = max(active.energy / max(active.pool.rows.freedom - active.unknowns, 1.0), LEAST_NOISE**2)
        moved = {g: a * (target[g] / a) ** step for g, a in active.variances.items()}
        trial = replace(active, variances=moved, sigma2=active.sigma2 * (sigma2 / active.sigma2) ** step)
        gained = trial.evidence - active.evidence
        if gained < -1e-9:
            step *= 0.5
            if step < 0.05:
                return active
            continue
        active, step = trial, min(1.0, 1.5 * step)
        if gained < SETTLED:
            return active
    return active


def backward_eliminated(active: Active) -> Active:
    """Backward elimination of groups that gain less than the least nats, the worst first, and of idle parts."""
    while True:
        worst = min(found(active), key=active.net_nats, default=None)
        if worst is None or active.net_nats(worst) >= active.criteria.minimum_nats:
            return _without_idle_parts(active)
        active = with_optimal_variances(active.without(worst), 3)


def _without_idle_parts(active: Active) -> Active:
    """Groups of several places without the places that the evidence does not want at the common variance."""
    for g in list(active.variances):
        parts = active.pool.groups[g].parts
        if not parts:
            continue
        of_column = parts_left(active, g)
        for part in np.unique(of_column)[::-1]:
            mine = np.flatnonzero(of_column == part)
            if len(mine) == len(of_column):
                break
            s, q = active.own(g, mine)
            a = active.variances[g]
            if 0.5 * float(np.sum(a * q**2 / (1 + a * s) - np.log1p(a * s))) < active.criteria.part_nats:
                left = of_column != part
                active = replace(active, chosen={**active.chosen, g: active.chosen[g][left]})
                of_column = of_column[left]
    return active


def parts_left(active: Active, g: int) -> IntArray:
    """Number of the part of each column that is left of a group at several places."""
    sizes = [len(part.effects) for part in active.pool.groups[g].parts]
    return np.asarray(np.repeat(np.arange(len(sizes)), sizes)[active.chosen[g]])


def forward_selected(active: Active, but: Set[int] = frozenset()) -> Active:
    """Forward selection: add the best group, but for some, while its net gain reaches the least nats; prune after each.

    Where none does at the present noise, one that does at its own comes in.
    After a full scan only its best hundred are looked at again, until none of them is worth adding.
    """
    active = with_optimal_variances(active)
    refused = set(but)
    among: IntArray | None = None
    for _ in range(MOST_MOVES):
        gains, variances, fit = scan(active, among)
        gains = gains - active.pool.cost
        gains[[*active.variances, *refused]] = -np.inf
        if gains.max() < active.criteria.minimum_nats:
            gains = with_own_noise(gains, fit, active.mismatch)
        g = int(np.argmax(gains))
        if gains[g] < active.criteria.minimum_nats:
            if among is None:
                return active
            among = None
            continue
        if among is None:
            among = np.argsort(-gains)[:SHORT_LIST]
        before = active.evidence
        trial = backward_eliminated(with_optimal_variances(active.added(g, float(variances[g])), 4))
        if trial.evidence > before and g in trial.variances and not rests_on_one_pose(active, trial):
            active = trial
        else:
            refused.add(g)
    return active


def stepwise(active: Active) -> Active:
    """Stepwise selection: forward, then backward at the optimal variances."""
    return backward_eliminated(with_optimal_variances(forward_selected(active)))


def first_better(active: Active, trials: Iterable[Active]) -> Active:
    """The first trial that raises the evidence by what settles it, else the model as it is."""
    return next((trial for trial in trials if trial.evidence > active.evidence + SETTLED), active)


def split(active: Active) -> Active:
    """Groups of several places as one group a place where each place stands on its own: said by name."""
    number = {group.name: g for g, group in enumerate(active.pool.groups)}
    for g in list(active.variances):
        parts = active.pool.groups[g].parts
        if not parts:
            continue
        of_column = parts_left(active, g)
        trial = active.without(g)
        for part in np.unique(of_column):
            trial = trial.added(number[parts[part].name], active.variances[g] / len(parts))
        trial = with_optimal_variances(trial)
        new = [h for h in trial.variances if h not in active.variances]
        if all(trial.net_nats(h) >= active.criteria.minimum_nats for h in new):
            active = trial
    return active


def rests_on_one_pose(before: Active, after: Active) -> bool:
    """Whether one pose alone brings most of what a move gains: an outlier that a law has bent itself to."""
    gained = before.misfit * (before.sigma2 / after.sigma2) - after.misfit
    return float(gained.max()) > before.criteria.one_pose_share * float(gained.sum())


def found(active: Active) -> list[int]:
    """Groups in the model that are not always in it."""
    return [g for g in active.variances if not active.pool.groups[g].always_included]
