"""Find the credible set of a selected group: all candidates that could replace the group, with their probabilities.

    p(h | y) ∝ exp L(model with h in the place of the selected group g),   h over all candidate groups

L is the objective of the selection: log marginal likelihood minus penalty, nats. The other groups are re-estimated
given h, and groups made superfluous by h are deleted. Candidates that differ only in constants inside their basis
functions, such as a time constant, are one cause. A joint group of several sites with the group g is no cause, because
a joint group adds other sites. All unnamed candidates together are one cause, "none of these". Sources: Wang
(2020), sum of single effects; Raftery (1997), averaging over models near the best model.
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
"""NEAR: largest loss of log evidence, nats, of a replacement to re-estimate (beyond: probability < 0.0001). MOST:
largest number of re-estimated groups. ALIKE: relative difference of motion that the measured poses cannot resolve."""


@dataclass(frozen=True)
class Cause:
    """A possible cause of a finding: groups of effects that the data cannot distinguish, and their probability.

    own: whether the selected group is one of the groups of the cause, then the first one. amount: motion by the
    selected effects if the cause is true, as a multiple of the fitted motion; 0 for effects outside the cause.
    """

    groups: tuple[Group, ...]
    probability: float
    own: bool
    amount: float = 0.0


@dataclass(frozen=True)
class CredibleSet:
    """Possible causes of a finding, the most probable first. none: probability (0 to 1) that the cause has no name."""

    causes: tuple[Cause, ...]
    none: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all possible causes in the credible set of a finding."""
        return tuple(group.name for cause in self.causes for group in cause.groups)


def credible_set(model: Active, g: int, sites: Sequence[Site] = (), inputs: Sequence[str] = ()) -> CredibleSet:
    """Compute the probability of each candidate effect to be the true cause of a finding. g: index of its group."""
    near, groups = dict(_near(model, g)), model.pool.groups
    unnamed = _smooth_terms(model, g, sites, inputs) if _named(groups[g]) else np.zeros(0)
    total = float(logsumexp([*(trial.objective for trial in near.values()), *unnamed]))
    named = {h: float(np.exp(trial.objective - total)) for h, trial in near.items() if _named(groups[h])}
    lines = [*_lines(model, g, named), (1.0 - sum(named.values()), ())]
    lines.sort(key=lambda line: -line[0])
    kept = lines[: 1 + int(np.searchsorted(np.cumsum([p for p, _ in lines]), COVERAGE))]
    causes = tuple(
        Cause(tuple(groups[h] for h in line), p, g in line, _amount(model, g, near[line[0]], line[0]))
        for p, line in kept if line
    )  # fmt: skip
    return CredibleSet(causes, next((p for p, line in kept if not line), 0.0))


def _named(group: Group) -> bool:
    return bool(group.family) and not is_curve(group)


def _kind(group: Group) -> str:
    """Return the name of a group of effects with symbols in place of the constants in its basis functions."""
    return group.inner.name if group.inner else group.name


def _amount(model: Active, g: int, trial: Active, h: int) -> float:
    """Return the motion by selected effects if group h replaces group g, as a multiple of their motion in the model."""
    own, other = _motion(model, g), _motion(trial, h)
    square = sum(value**2 for value in own.values())
    return sum(value * other[term] for term, value in own.items() if term in other) / square if square else 0.0


def _motion(model: Active, g: int) -> dict[tuple[str, str, str], float]:
    """Return the fitted coefficient times weight of each term of a group, by slot (frame), axis and basis function."""
    values = zip(model.chosen[g].tolist(), (model.scale * model.mean)[model.blocks[g]].tolist(), strict=True)
    terms = ((value, term) for k, value in values for term in model.pool.groups[g].effects[k].terms)
    return {(t.slot, t.axis, str(t.basis)): value * t.weight for value, t in terms}


def _near(model: Active, g: int) -> Iterable[tuple[int, Active]]:
    """Yield the index of each group that could replace group g, first g itself, and the model with the replacement.

    The smooth terms of other groups keep their prior variances during the replacement.
    """
    yield g, model
    model, own = beside_curves(model, [g], model.pools), model.pool.groups[g].effects
    fewer = model.without(g)
    gains, variances, _ = Scan(fewer).gains(model.net_gain(g) - NEAR + fewer.prices)
    smooth = [h for h, group in enumerate(model.pool.groups) if group.found_by == SMOOTH_TERM]
    net = gains - fewer.prices
    wider = [h for h, group in enumerate(model.pool.groups) if group.parts and {*own} <= {*group.effects}]
    net[[*model.variances, *smooth, *wider]] = -np.inf
    for h in np.argsort(-net, kind="stable")[:MOST].tolist():
        if net[h] < model.net_gain(g) - NEAR:
            return
        trial = prune(reestimate(fewer.added(h, float(variances[h]))), exempt=h)
        if len(np.unique(trial.part_of_column(h))) != 1:
            yield h, trial


def _smooth_terms(model: Active, g: int, sites: Sequence[Site], inputs: Sequence[str]) -> Array:
    """Return the objective L, nats, of models in which one smooth term replaces group g, one value per term."""
    slots = {slot for e in model.pool.groups[g].effects for slot in e.slots}
    there = [site for site in sites if not slots.isdisjoint(slot for slot, _, _ in site.terms)]
    if not there or not inputs:
        return np.zeros(0)
    fewer = prune(reestimate(model.without(g)))
    return fewer.objective + nats_without_a_name(fewer, there, inputs, len(sites))


def _lines(model: Active, g: int, chance: dict[int, float]) -> list[tuple[float, tuple[int, ...]]]:
    """Merge groups of one kind, and groups that move the measured points equally, to one cause each.

    Return the probability of each cause, and the indices of its groups, one of each kind. chance: probability by group.
    """
    fewer, groups, lines = model.without(g), model.pool.groups, list[tuple[dict[str, int], Array, list[float]]]()
    for h in sorted(chance, key=lambda h: (h != g, -round(chance[h], 6), groups[h].name)):
        moved, kind = _contribution(fewer, h), _kind(groups[h])
        for line, first, share in lines:
            if kind in line or np.linalg.norm(moved - first) < ALIKE * np.linalg.norm(first):
                line.setdefault(kind, h)
                share.append(chance[h])
                break
        else:
            lines.append(({kind: h}, moved, [chance[h]]))
    return [(sum(share), tuple(line.values())) for line, _, share in lines]


def _contribution(fewer: Active, h: int) -> Array:
    """Return the least-squares contribution of a group of effects to a model's residual, one value per measured row."""
    columns = fewer.pool.columns(h)
    columns = columns - fewer.spanned @ (fewer.spanned.T @ columns)
    return np.asarray(columns @ np.linalg.lstsq(columns, fewer.left, rcond=None)[0])
