"""Select groups of effects: linearise the chain, propose candidates, select, fit the exact chain, until convergence."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from threadpoolctl import threadpool_limits

from gpmodel.calibration.gauss_newton import fitting_of
from gpmodel.calibration.noise import pose_ratio
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.executor import ALONE, Workers, called
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.states import States
from gpmodel.selection.group import Group, Price, Shapes, geometry_groups
from gpmodel.selection.offers import Offering, singles, without_copies
from gpmodel.selection.posterior import Active
from gpmodel.selection.relinearise import Expansion, Screening, relinearised, with_only
from gpmodel.selection.result import Offered, Selection, summarised
from gpmodel.selection.sinusoids import propose_sinusoids
from gpmodel.selection.smooth_terms import propose_smooth_terms
from gpmodel.selection.sparse_bayes import exchange, grow

Step = Callable[[Active], Active]

Proposer = Callable[[Selection], tuple[Sequence[Group], frozenset[str]]]
"""Function from a selection to candidate groups for its residual, and the names of smooth terms with formulas."""


def select(
    calibration: Calibration,
    poses: Poses,
    offering: Offering,
    *,
    prices: Price | None = None,
    workers: Workers = ALONE,
    propose: Proposer | None = None,
) -> Selection:
    """Select groups of effects by marginal likelihood, and propose new groups for the residual, until nothing changes.

    A step of the selection adds and deletes groups, then exchanges groups. Smooth terms and sinusoids are proposed for
    the residual of every new selection; `propose` proposes other groups, such as formulas, if the selection is
    unchanged. poses: poses of the calibration. workers: processes that search for proposals.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        chosen = nothing_selected(calibration, poses, prices or Price(), offering.grids)
        groups = singles(offering, calibration.model.mechanism, chosen.offered.screening.shapes)
        new = _smooth_terms(chosen.active, offering)
        step: Step = grow
        seen = set[frozenset[str]]()  # a selection that recurs after another linearisation is no new one
        settled: frozenset[str] | None = None
        while True:
            chosen = _among(chosen, groups, new, step)
            active, changed = chosen.active, chosen.names not in seen
            seen.add(chosen.names)
            if step is exchange:
                settled = chosen.names  # what was proposed since then was tried in the place of each group
            known = {group.name for group in active.pool.groups}
            new = []
            if changed:
                sources = [partial(propose_sinusoids, active, offering.grids)]
                if chosen.kept:
                    sources.insert(0, partial(_smooth_terms, active, offering))
                new = [group for found in called(workers, sources) for group in found if group.name not in known]
            if new and step is grow:
                continue
            if not new and (settled is not None or not chosen.kept):
                further, curves = propose(chosen) if propose and chosen.kept else ((), frozenset())
                new = [group for group in further if group.name not in known]
                if not new and (chosen.names == settled or not chosen.kept):
                    return chosen
                chosen = replace(chosen, offered=chosen.offered.with_formulas_of(curves))
            step = partial(exchange, new=frozenset(group.name for group in new)) if new else exchange


def nothing_selected(
    calibration: Calibration, poses: Poses, prices: Price, grids: Sequence[FrequencyGrid]
) -> Selection:
    """Return a selection of no groups: its model has only the effects of a calibration, linearised at their values."""
    screening = Screening(Shapes(_predicted_states(calibration, poses)), prices)
    base = geometry_groups(calibration.model.effects)
    fitting, theta, placement = fitting_of(calibration, poses), calibration.theta, calibration.placement
    ratio = pose_ratio(fitting.at(theta, placement), fitting.block, 0.0, float(len(theta)))
    state = Expansion(replace(fitting, ratio=ratio, noise_shape=None), theta, placement, calibration.sigma)
    return Selection((), Offered(screening, base, (), (), grids), with_only(screening, base, state), state)


def _among(before: Selection, groups: Sequence[Group], new: Sequence[Group], step: Step) -> Selection:
    """Make a step of the selection from an earlier selection. Every old or new group may be added or deleted."""
    offered = before.offered
    known = {group.name for group in groups}
    unique = {group.name: group for group in (*offered.proposed, *new) if group.name not in known}
    proposed = without_copies(unique.values())
    offered = replace(offered, single=tuple(groups), proposed=tuple(proposed))
    mechanism = before.state.fitting.model.mechanism
    return summarised(offered, *relinearised(offered.screening, offered.groups(mechanism), before.state, step))


def _smooth_terms(active: Active, offering: Offering) -> list[Group]:
    """Propose smooth terms of one and two inputs for the residual of a model."""
    if not offering.inputs:
        return []
    return [group for group in propose_smooth_terms(active, offering.sites, offering.inputs) if offering.wanted(group)]


def _predicted_states(calibration: Calibration, poses: Poses) -> States:
    """Return the inputs of effects at some poses, with the predicted point in the frame of the instrument.

    The measured point itself is no input: the point contains noise, and its effects could absorb the arm's lengths.
    """
    there = resolved(calibration, poses)
    observed = observe(calibration.model, there, calibration.theta, calibration.placement)
    if there.states.seen is None:
        return there.states
    points = there.states.seen.points.copy()
    points[slice(None) if there.states.rows is None else there.states.rows] = observed.tip[:, :3, 3]
    return replace(there.states, seen=replace(there.states.seen, points=points))
