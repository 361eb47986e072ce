"""What groups are chosen for, and what is chosen of all that is offered."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gpmodel.calibration.gauge import moving_sites, stands_still, still_joints
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.one_place import is_curve
from gpmodel.discovery.readable import readable_inputs
from gpmodel.discovery.search import Search
from gpmodel.discovery.walk import is_timed
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import family
from gpmodel.families.inner import remembered
from gpmodel.families.offer import Offer
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import sites_of
from gpmodel.selection.group import Group
from gpmodel.selection.offers import Builder, Offering, of_evolved, of_offers
from gpmodel.selection.result import Kept, Selection
from gpmodel.selection.select import select, select_again
from gpmodel.selection.waves import grids_of
from gpmodel.table.split import JUDGED

PLAIN = 2
"""Effects up to which a group is solved by plain least squares: a number or a sine and cosine need no prior."""


@dataclass(frozen=True)
class Choice:
    """What groups are chosen for.

    fit: calibrates the training poses with candidates, from a fit to go on from. offers: what the catalogue and its
    user name. pointed: inputs that stand out of the histograms, None where there is none. late: whether the time is up.
    fresh: names of what was evolved since the last choice. timed: laws of the rows or of the time that alone may be
    offered, None for all. outdone: what is not offered, since something else predicts better in its place. simplified:
    whether laws are written as computer algebra does; their values are the same.
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
    outdone: frozenset[str] = frozenset()
    simplified: bool = True

    def asks_for(self, group: Group) -> bool:
        """Whether a group may be offered: what follows an input by no mechanism only where a histogram points at it."""
        if group.name in self.outdone:
            return False
        if self.timed is not None and group.name not in self.timed and is_timed(group, self.train.states):
            return False
        known = family(group.family)
        proxy = known is not None and known.needs_pointing
        return self.pointed is None or not proxy or not self.pointed.isdisjoint(group.inputs)

    def residual(self, calibration: Calibration) -> Residual:
        """What a calibration leaves of the training poses."""
        return residual_of(calibration, self.train, self.criteria, JUDGED)


@dataclass(frozen=True)
class Together:
    """What was chosen, as candidates by name, and what a fit with all of them leaves."""

    chosen: Selection
    candidates: dict[str, Candidate]
    left: Residual


Laws = Mapping[tuple[str, ...], Candidate]
"""Laws by the names of what was chosen that each says in its place."""


def chosen_together(choice: Choice, evolved: Sequence[Candidate]) -> Together:
    """What is chosen of all that is offered but for groups at joints that stand still, and fitted.

    What was evolved in several terms is offered term by term where one of them has a name by itself.
    """
    mechanism, states = choice.standard.model.mechanism, choice.train.states
    still = still_joints(mechanism, choice.train.dataset)
    inputs = readable_inputs(states, np.arange(len(states)))[0].names
    sites = moving_sites(mechanism, choice.train.dataset)
    grids = grids_of(choice.offers, mechanism, states)
    grids = [c for c in grids if not stands_still((slot for slot, _, _ in c.joint.drive), still)]

    def wanted(group: Group) -> bool:
        return choice.asks_for(group) and not all(stands_still(e.slots, still) for e in group.effects)

    offering = Offering((of_offers(choice.offers), _of_laws(choice, evolved)), sites, inputs, grids, wanted)
    workers = choice.search.here
    chosen = select(choice.standard, choice.train, offering, criteria=choice.criteria, seed=JUDGED, workers=workers)
    return _fitted(choice, chosen)


def chosen_again(choice: Choice, before: Together, laws: Laws) -> Together:
    """What is chosen from there on with laws in their places, and fitted.

    What they stand for is not offered again, nor are curves that were not chosen and read what laws read, beside
    nothing but what was chosen reads: they would say the same elsewhere or together.
    """
    read = {name for candidate in before.candidates.values() for name in candidate.inputs}
    said = {name for law in laws.values() for name in law.inputs}

    def repeats(group: Group) -> bool:
        inputs = set(group.inputs)
        return is_curve(group) and group.name not in before.candidates and bool(inputs & said) and inputs <= read

    def wanted(group: Group) -> bool:
        return (group.name,) not in laws and not repeats(group) and choice.asks_for(group)

    offering = Offering((_of_laws(choice, tuple(laws.values())),), wanted=wanted)
    return _fitted(choice, select_again(before.chosen, offering, laws))


def _of_laws(choice: Choice, evolved: Sequence[Candidate]) -> Builder:
    """What was evolved, as groups whose costs count the places there are."""
    cost = partial(choice.search.cost, places=len(sites_of(choice.standard.model.mechanism)))
    return of_evolved(evolved, cost)


def _fitted(choice: Choice, chosen: Selection) -> Together:
    """What was chosen as candidates, and the fit with them."""
    candidates = {kept.group.name: as_candidate(kept, choice.train) for kept in chosen.kept}
    left = choice.residual(choice.fit(tuple(candidates.values()), choice.standard))
    return Together(chosen, candidates, left)


def as_candidate(kept: Kept, poses: Poses) -> Candidate:
    """A kept group as a candidate: a curve with its learned priors, what has at most two numbers without, unless
    somebody stated how large they are; the constants of what it remembers are its own."""
    group = kept.group
    plain = len(group.effects) <= PLAIN and not group.believed
    effects = tuple(replace(e, prior=np.inf) for e in group.effects) if plain else kept.effects
    derived = plain and set(group.inputs).isdisjoint(poses.dataset.extras)
    inner = group.inner or (remembered(group.name, effects, poses.states.unit_of_constant) if derived else None)
    return Candidate(group.name, effects, group.family, group.cost, group.found_by, group.explanation, inner)
