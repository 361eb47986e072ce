"""Find the credible set of a selected group: all candidates that could replace it, with their probabilities.

    p(h | y) ∝ exp L(model with h in the place of g),   h over all groups of the pool

L is the objective of the selection: log marginal likelihood minus price. The rest of the model is re-estimated with h,
and groups that h makes superfluous are deleted. All unnamed candidates are one cause, "none of these". Sources: Wang et
al. (2020), a sum of single effects; Raftery et al. (1997), the models near the best one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from gpmodel.arrays import Array
from gpmodel.families.candidate import SMOOTH_TERM
from gpmodel.model.sites import Site
from gpmodel.numerics.interval import COVERAGE
from gpmodel.selection.group import Group, is_curve
from gpmodel.selection.posterior import Active
from gpmodel.selection.scan import Scan, beside_curves
from gpmodel.selection.smooth_terms import nats_without_a_name
from gpmodel.selection.sparse_bayes import prune, reestimate

NEAR, MOST, ALIKE = 9.0, 40, 1e-3
"""Candidates within NEAR nats of the best are re-estimated, at most MOST of them; others have a probability below
0.0001. ALIKE: relative difference of contributions below which no measurement at these poses distinguishes them."""


@dataclass(frozen=True)
class Cause:
    """Indistinguishable groups, the most probable first, and their probability. own: one of them is selected."""

    groups: tuple[Group, ...]
    probability: float
    own: bool


@dataclass(frozen=True)
class CredibleSet:
    """Causes, the most probable first. none: probability of an unnamed cause, 0 outside the set."""

    causes: tuple[Cause, ...]
    none: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all causes."""
        return tuple(group.name for cause in self.causes for group in cause.groups)

    @property
    def others(self) -> tuple[Cause, ...]:
        """Causes that do not contain the selected group."""
        return tuple(cause for cause in self.causes if not cause.own)


def credible_set(model: Active, g: int, sites: Sequence[Site] = (), inputs: Sequence[str] = ()) -> CredibleSet:
    """Compute the probabilities of all candidates in the place of a selected group. sites, inputs: of smooth terms."""
    near, group = dict(_near(model, g)), model.pool.groups[g]
    unnamed = _smooth_terms(model, g, sites, inputs) if _named(group) else np.zeros(0)
    total = float(logsumexp([*near.values(), *unnamed]))
    named = {h: float(np.exp(value - total)) for h, value in near.items() if _named(model.pool.groups[h])}
    lines = [(p, line) for line, p in _lines(model.without(g), named)]
    lines.append((1.0 - sum(named.values()), ()))
    lines.sort(key=lambda line: -line[0])
    kept = lines[: 1 + int(np.searchsorted(np.cumsum([p for p, _ in lines]), COVERAGE))]
    groups = model.pool.groups
    causes = tuple(Cause(tuple(groups[h] for h in line), p, g in line) for p, line in kept if line)
    return CredibleSet(causes, next((p for p, line in kept if not line), 0.0))


def _named(group: Group) -> bool:
    return bool(group.family) and not is_curve(group)


def _near(model: Active, g: int) -> Iterable[tuple[int, float]]:
    """Yield candidates in the place of a group, itself included, with the objective (nats) of the model with each.

    Curves of other groups keep their variances.
    """
    yield g, model.objective
    model = beside_curves(model, [g], model.pools)
    fewer = model.without(g)
    gains, variances, _ = Scan(fewer).gains(model.net_gain(g) - NEAR + fewer.prices)
    smooth = [h for h, group in enumerate(model.pool.groups) if group.found_by == SMOOTH_TERM]
    net = gains - fewer.prices
    net[[*model.variances, *smooth]] = -np.inf
    for h in np.argsort(-net, kind="stable")[:MOST].tolist():
        if net[h] < model.net_gain(g) - NEAR:
            return
        trial = prune(reestimate(fewer.added(h, float(variances[h]))), exempt=h)
        if len(np.unique(trial.part_of_column(h))) != 1:
            yield h, trial.objective


def _smooth_terms(model: Active, g: int, sites: Sequence[Site], inputs: Sequence[str]) -> Array:
    """Return the objective (K,), nats, of the model with each smooth term in the place of a group."""
    slots = {slot for e in model.pool.groups[g].effects for slot in e.slots}
    there = [site for site in sites if not slots.isdisjoint(slot for slot, _, _ in site.terms)]
    if not there or not inputs:
        return np.zeros(0)
    fewer = prune(reestimate(model.without(g)))
    return fewer.objective + nats_without_a_name(fewer, there, inputs, len(sites))


def _lines(fewer: Active, chance: dict[int, float]) -> list[tuple[tuple[int, ...], float]]:
    """Merge groups with equal contributions given a model, and return each set with its total probability."""
    lines: list[tuple[list[int], Array]] = []
    for h in sorted(chance, key=lambda h: (-round(chance[h], 6), fewer.pool.groups[h].name)):
        moved = _contribution(fewer, h)
        for line, first in lines:
            if np.linalg.norm(moved - first) < ALIKE * np.linalg.norm(first):
                line.append(h)
                break
        else:
            lines.append(([h], moved))
    return [(tuple(line), sum(chance[h] for h in line)) for line, _ in lines]


def _contribution(fewer: Active, h: int) -> Array:
    """Return the least-squares contribution (M,) of a group to the residual of a model."""
    columns = fewer.pool.columns(h)
    columns = columns - fewer.spanned @ (fewer.spanned.T @ columns)
    return np.asarray(columns @ np.linalg.lstsq(columns, fewer.left, rcond=None)[0])
