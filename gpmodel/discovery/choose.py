"""Select effects jointly from the catalogue, evolved programs, smooth terms, sinusoids, and formulas."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from gpmodel.calibration.gauge import at_fixed_joints, moving_sites, still_joints
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.formulas import PLAIN, ShortLaw, curves_of, formulas
from gpmodel.discovery.refinement import refined_at_one_site
from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import readable_inputs
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import Offer
from gpmodel.families.inner import lag_constants
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import Site, sites_of
from gpmodel.selection.group import Group, Price, group_of
from gpmodel.selection.offers import Offering, of_evolved, of_offers
from gpmodel.selection.result import Kept, Selection
from gpmodel.selection.select import select
from gpmodel.selection.sinusoids import grids_of
from gpmodel.table.blocks import FOLD_SEED


@dataclass(frozen=True)
class Problem:
    """Inputs of a selection of groups of effects.

    standard: calibration of the standard model.
    fit: function that calibrates the training poses with candidates, starting from an earlier fit.
    offers: candidates of the catalogue, and the user's families and candidates.
    input_prices: penalty of each input variable, nats, from the histograms of inputs in evolved programs.
    late: function that returns whether the time limit of the search is reached.
    """

    standard: Calibration
    fit: Callable[[Sequence[Candidate], Calibration], Calibration]
    train: Poses
    offers: Sequence[Offer]
    search: Search
    criteria: Criteria
    input_prices: Mapping[str, float] = field(default_factory=dict)
    late: Callable[[], bool] = lambda: False

    @cached_property
    def smooth_sites(self) -> tuple[tuple[Site, ...], tuple[str, ...]]:
        """Sites (frame and axis) and input variables of the smooth terms that may be proposed at the training poses."""
        states = self.train.states
        inputs = readable_inputs(states, np.arange(len(states)))[0].names
        return tuple(moving_sites(self.standard.model.mechanism, self.train.dataset)), tuple(inputs)

    def residual(self, calibration: Calibration) -> Residual:
        """Return the residual of a calibration at the training poses."""
        return residual_of(calibration, self.train, self.criteria, FOLD_SEED)

    def fitted(self, chosen: Selection) -> "FittedSelection":
        """Convert the groups of a selection to candidate effects, and fit all these candidates together."""
        candidates = {kept.group.name: as_candidate(kept, self.train) for kept in chosen.kept}
        found = tuple(candidates.values())
        return FittedSelection(chosen, candidates, self.residual(self.fit(found, self.standard)))


@dataclass(frozen=True)
class FittedSelection:
    """A selection, its groups as candidate effects by name, and the residual of the fit with all these candidates."""

    chosen: Selection
    candidates: dict[str, Candidate]
    left: Residual


@dataclass
class Proposals:
    """Propose formulas for the smooth terms of a selection, once per term, and candidates with refitted constants.

    fresh: names of programs evolved in the current round. laws: every proposed formula, by the name of its candidate.
    """

    problem: Problem
    fresh: frozenset[str]
    asked: set[tuple[str, ...]] = field(default_factory=set)
    laws: dict[str, ShortLaw] = field(default_factory=dict)
    last: FittedSelection | None = None

    def __call__(self, chosen: Selection) -> tuple[Sequence[Group], frozenset[str]]:
        """Return groups proposed for the residual of a selection, and names of smooth terms with a proposed formula."""
        self.last = fitted = self.problem.fitted(chosen)
        shapes = chosen.offered.screening.shapes
        kept = list(zip(fitted.candidates.values(), chosen.kept, strict=True))
        curves = {names: c for names, c in curves_of(kept, self.fresh).items() if names not in self.asked}
        self.asked.update(curves)
        searched = () if self.problem.late() else formulas(fitted.left, list(curves.values()), self.problem.search)
        laws = {law.candidate.name: law for law in searched}
        self.laws |= laws
        moved = refined_at_one_site(fitted.left, fitted.candidates)
        groups = (group_of(c, shapes) for c in (*(law.candidate for law in laws.values()), *moved))
        return [group for group in groups if group is not None], frozenset(name for names in curves for name in names)


def choose(problem: Problem, evolved: Sequence[Candidate], fresh: frozenset[str]) -> tuple[FittedSelection, Proposals]:
    """Select among all candidate groups of effects, except at joints that do not move, and fit the selected effects.

    The terms of an evolved program become separate candidates if one of the terms has a name. evolved: evolved programs
    of all rounds. fresh: names of programs evolved in the current round.
    """
    mechanism, states = problem.standard.model.mechanism, problem.train.states
    still = still_joints(mechanism, problem.train.dataset)
    grids = grids_of(problem.offers, mechanism, states)
    grids = [c for c in grids if not at_fixed_joints((slot for slot, _, _ in c.joint.drive), still)]

    declared = {e.terms for e in problem.standard.model.effects if not e.constant}

    def wanted(group: Group) -> bool:
        return not all(e.terms in declared or at_fixed_joints(e.slots, still) for e in group.effects)

    cost = partial(problem.search.cost, places=len(sites_of(mechanism)))
    offering = Offering((of_offers(problem.offers), of_evolved(evolved, cost)), *problem.smooth_sites, grids, wanted)
    proposals = Proposals(problem, fresh)
    chosen = select(
        problem.standard, problem.train, offering, prices=Price(problem.criteria, problem.input_prices),
        workers=problem.search.here, propose=proposals,
    )  # fmt: skip
    last = proposals.last
    return last if last is not None and last.chosen is chosen else problem.fitted(chosen), proposals


def as_candidate(kept: Kept, poses: Poses) -> Candidate:
    """Convert a selected group of effects to a candidate for the fit to the training poses.

    A smooth term keeps the prior variance that the selection has estimated. A group of at most two coefficients gets
    flat priors, unless the user has specified priors.
    """
    group = kept.group
    plain = len(group.effects) <= PLAIN and not group.specified
    effects = tuple(replace(e, prior=np.inf) for e in group.effects) if plain else kept.effects
    derived = plain and set(group.inputs).isdisjoint(poses.dataset.extras)
    inner = group.inner or (lag_constants(group.name, effects, poses.states.unit_of_constant) if derived else None)
    return Candidate(group.name, effects, group.family, group.cost, group.found_by, group.explanation, inner)


def simplified(problem: Problem, fitted: FittedSelection, laws: Iterable[ShortLaw]) -> FittedSelection:
    """Simplify the formulas of a selection by computer algebra, and refit the selection if any formula changed."""
    written = {law.candidate.name: law.simplified() for law in laws if law.candidate.name in fitted.candidates}
    candidates = {name: written.get(name, c) for name, c in fitted.candidates.items()}
    if candidates == fitted.candidates:
        return fitted
    calibration = problem.fit(tuple(candidates.values()), fitted.left.calibration)
    return FittedSelection(fitted.chosen, candidates, problem.residual(calibration))
