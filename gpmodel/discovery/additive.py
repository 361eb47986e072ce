"""The additive part of what is missing: groups chosen together, each then held to the criteria like any finding."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from types import MappingProxyType

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauge import moving_sites, stands_still, still_joints
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.acceptance import Hypothesis, eliminate_and_readmit, tested
from gpmodel.discovery.averaging import averaged, predicted_alike
from gpmodel.discovery.compact import compact_laws, is_curve, leeway, of_one_place, replacement
from gpmodel.discovery.detail import detailed
from gpmodel.discovery.readable import readable_inputs
from gpmodel.discovery.refinement import refined_fit, told_apart
from gpmodel.discovery.search import Search
from gpmodel.discovery.walk import is_timed
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.chance import chance
from gpmodel.executor import called
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import family
from gpmodel.families.inner import remembered
from gpmodel.families.offer import Offer
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import sites_of
from gpmodel.selection.group import Group
from gpmodel.selection.offers import Offering, of_evolved, of_offers
from gpmodel.selection.result import Kept, Selection
from gpmodel.selection.select import select
from gpmodel.selection.waves import grids_of
from gpmodel.table.split import JUDGED

PLAIN = 2
"""Effects up to which a group is solved by plain least squares: a number or a sine and cosine need no prior."""

MOST_DETERMINED = 20.0
"""Unknowns of a curve that the data determine, up to which a law may say the same: the most that a smooth curve has. A
law of seven nodes has three constants."""


@dataclass(frozen=True)
class Additive:
    """What was chosen together. hypotheses: every chosen group, judged, the worthiest first. calibration: with the
    accepted ones. null_nats: (T,) the most that any group gains on permuted residuals. laws: short ones evolved for the
    curves that were chosen, offered beside them. offered_as: names of the accepted before constants in them moved."""

    hypotheses: tuple[Hypothesis, ...]
    calibration: Calibration
    null_nats: Array
    laws: tuple[Candidate, ...] = ()
    offered_as: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Choice:
    """What groups are chosen for.

    fit: calibrates the training poses with candidates, from a fit to go on from. offers: what the catalogue and its
    user name. pointed: inputs that stand out of the histograms, None where there is none. late: whether the time is up.
    fresh: names of what was evolved since the last choice. timed: laws of the rows or of the time that alone may be
    offered, None for all.
    """

    standard: Calibration
    fit: Callable[[Sequence[Candidate], Calibration], Calibration]
    train: Poses
    offers: Sequence[Offer]
    search: Search
    criteria: Criteria
    pointed: frozenset[str] | None = None
    late: Callable[[], bool] = lambda: False
    fresh: frozenset[str] = frozenset()
    timed: frozenset[str] | None = None

    def asks_for(self, group: Group) -> bool:
        """Whether a group may be offered: what follows an input by no mechanism only where a histogram points at it."""
        if self.timed is not None and group.name not in self.timed and is_timed(group, self.train.states):
            return False
        known = family(group.family)
        proxy = known is not None and known.needs_pointing
        return self.pointed is None or not proxy or not self.pointed.isdisjoint(group.inputs)

    def residual(self, calibration: Calibration) -> Residual:
        """What a calibration leaves of the training poses."""
        return residual_of(calibration, self.train, self.criteria, JUDGED)


def additive(choice: Choice, evolved: Sequence[Candidate]) -> Additive:
    """Choose groups beside a calibration's own effects, fit them, and judge each beside all the others.

    evolved: what GP found, as groups among the others. A curve that a short law predicts as well as gives way to the
    law, and the groups are chosen once more; these stand where they are as likely as before, but for what every law is
    allowed. One that fails a criterion is left out and the rest fitted again. Where a random walk explains more than
    a law of the time, the groups are chosen without such laws, but those that passed: several of them together had
    stood for the walk.
    """
    last = first = _together(choice, _chosen(choice, evolved))
    if laws := _laws(choice, first):
        last = _together(choice, _chosen(choice, (*evolved, *laws.values()), first.candidates, laws))
        said = {name for law in laws.values() if law.name in last.candidates for name in law.inputs}
        gone = (c for name, c in first.candidates.items() if name not in last.candidates and said.issuperset(c.inputs))
        if first.chosen.likelier_by(last.chosen) > leeway(gone, choice.criteria):
            last, laws = first, {}
    every = (*evolved, *laws.values())
    found = _accepted(choice, last)
    if any(not h.verdict.passed("walk") for h in found.hypotheses):
        without = replace(choice, timed=found.offered_as)
        again = _accepted(choice, _together(choice, _chosen(without, every, first.candidates, laws)))
        told = {h.candidate.name for h in again.hypotheses}
        refused = (h for h in found.hypotheses if not h.accepted and h.candidate.name not in told)
        found = replace(again, hypotheses=(*again.hypotheses, *refused))
    return replace(found, laws=tuple(laws.values()))


@dataclass(frozen=True)
class _Together:
    """What was chosen, as candidates by name, and what a fit with all of them leaves."""

    chosen: Selection
    candidates: dict[str, Candidate]
    left: Residual


def _together(choice: Choice, chosen: Selection) -> _Together:
    candidates = {kept.group.name: as_candidate(kept, choice.train) for kept in chosen.kept}
    left = choice.residual(choice.fit(tuple(candidates.values()), choice.standard))
    return _Together(chosen, candidates, left)


def _chosen(
    choice: Choice,
    evolved: Sequence[Candidate],
    before: Mapping[str, Candidate] = MappingProxyType({}),
    laws: Mapping[str, Candidate] = MappingProxyType({}),
) -> Selection:
    """What is chosen of all that is offered but for groups at joints that stand still.

    before: what was chosen, of which some have laws. These are not offered again, nor are curves that were not chosen
    and read what laws read, beside nothing but what was chosen reads: they would say the same elsewhere or together.
    What was evolved in several terms is offered term by term where one of them has a name by itself.
    """
    read = {name for candidate in before.values() for name in candidate.inputs}
    said = {name for law in laws.values() for name in law.inputs}
    mechanism = choice.standard.model.mechanism
    cost = partial(choice.search.cost, places=len(sites_of(mechanism)))
    builders = of_offers(choice.offers), of_evolved(evolved, cost)
    still = still_joints(mechanism, choice.train.dataset)

    def repeats(group: Group) -> bool:
        inputs = set(group.inputs)
        return is_curve(group) and group.name not in before and bool(inputs & said) and inputs <= read

    def wanted(group: Group) -> bool:
        return (
            group.name not in laws
            and not repeats(group)
            and choice.asks_for(group)
            and not all(stands_still(e.slots, still) for e in group.effects)
        )

    states = choice.train.states
    inputs = readable_inputs(states, np.arange(len(states)))[0].names
    sites = moving_sites(mechanism, choice.train.dataset)
    grids = grids_of(choice.offers, mechanism, choice.train.states)
    grids = [c for c in grids if not stands_still((slot for slot, _, _ in c.joint.drive), still)]
    offering = Offering(builders, sites, inputs, grids, wanted)
    return select(
        choice.standard, choice.train, offering, criteria=choice.criteria, seed=JUDGED, workers=choice.search.here
    )


def _laws(choice: Choice, first: _Together) -> dict[str, Candidate]:
    """Of every curve that was chosen, of what was evolved in several terms or just now, and of several at one place
    together: the law of one term that saves most, where it predicts as well within one standard error.

    Programs are bred at all places at once and miss forms that a search at one place looks at one by one. Curves with
    constants inside are refined instead. Terms were evolved beside poses that stood far out; now these are explained.
    """
    chosen = list(zip(first.candidates.values(), first.chosen.kept, strict=True))
    curves = [
        c
        for c, k in chosen
        if (PLAIN < k.determined <= MOST_DETERMINED and c.inner is None)
        or (not c.family and (len(c.effects) > 1 or c.name in choice.fresh))
    ]
    curves += of_one_place(c for c, k in chosen if k.determined <= MOST_DETERMINED)
    searched = () if choice.late() else compact_laws(first.left, curves, choice.search)
    found = ((curve.name, replacement(curve, residual, laws)) for curve, residual, laws in searched)
    return {name: law.simplified() for name, law in found if law}


def _accepted(choice: Choice, last: _Together) -> Additive:
    """The chosen groups that stand every test beside each other, fine curves in as much detail as their evidence asks:
    what is a line of a curve is no finding."""
    kept = {k.group.name: k for k in last.chosen.kept}
    residual = lru_cache(1)(choice.residual)
    offered, calibration = _in_detail(choice, last)
    apart = told_apart(residual(calibration), offered)
    if apart != offered:
        calibration = choice.fit(tuple(apart.values()), calibration)
    candidates, calibration = refined_fit(choice.fit, residual, apart, calibration)

    def verdicts(calibration: Calibration, asked: Mapping[str, Candidate]) -> dict[str, Hypothesis]:
        left = residual(calibration)

        def verdict(name: str) -> Hypothesis:
            return _judged(left.without(asked[name].effects), asked[name], kept[name], last.chosen)

        found = called(choice.search.here, [partial(verdict, name) for name in asked])
        return dict(zip(asked, found, strict=True))

    judged, calibration = eliminate_and_readmit(candidates, calibration, verdicts, choice.fit)
    passed = frozenset(name for name, h in judged.items() if h.accepted)
    return Additive(tuple(judged.values()), calibration, last.chosen.by_chance, offered_as=passed)


def _in_detail(choice: Choice, last: _Together) -> tuple[dict[str, Candidate], Calibration]:
    """What was chosen, its fine curves with twice their harmonics where they ask for them, and the fit with it."""
    calibration, offered = last.left.calibration, detailed(last.left, last.candidates)
    return offered, calibration if offered == last.candidates else choice.fit(tuple(offered.values()), calibration)


def as_candidate(kept: Kept, poses: Poses) -> Candidate:
    """A kept group as a candidate: a curve with its learned priors, what has at most two numbers without, unless
    somebody stated how large they are; the constants of what it remembers are its own."""
    group = kept.group
    plain = len(group.effects) <= PLAIN and not group.believed
    effects = tuple(replace(e, prior=np.inf) for e in group.effects) if plain else kept.effects
    derived = plain and set(group.inputs).isdisjoint(poses.dataset.extras)
    inner = group.inner or (remembered(group.name, effects, poses.states.unit_of_constant) if derived else None)
    return Candidate(group.name, effects, group.family, group.cost, group.found_by, group.explanation, inner)


def _judged(residual: Residual, candidate: Candidate, kept: Kept, chosen: Selection) -> Hypothesis:
    """The verdict on a kept group beside all the others; residual: without it."""
    before = cross_validated(residual.at_own_noise(), ())
    rivals = predicted_alike(residual, [group for group, _ in kept.rivals])
    nats = kept.gain - candidate.cost
    score = replace(scores(residual, [candidate])[0], nats=nats)
    by_chance = chance(nats - residual.criteria.head_start * (not candidate.family), chosen.by_chance)
    named = tuple((group.name, rms) for rms, group in rivals)
    return averaged(residual, tested(residual, candidate, score, by_chance, before, named), rivals)
