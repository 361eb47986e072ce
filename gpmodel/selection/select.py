"""Selection of groups: linearise, choose, solve the exact chain, look again."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.calibration.iterate import Fitting
from gpmodel.calibration.noise import pose_ratio
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.evidence.criteria import Criteria
from gpmodel.executor import Workers, called
from gpmodel.families.candidate import Candidate
from gpmodel.forks import ALONE
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.states import States
from gpmodel.selection.active import Active
from gpmodel.selection.group import Group, Shapes, geometry_groups
from gpmodel.selection.look import Screening, added, left_by, looked
from gpmodel.selection.offers import Offering, singles, without_copies
from gpmodel.selection.refit import Expansion
from gpmodel.selection.result import Among, Selection, summarised
from gpmodel.selection.surfaces import surfaces_left
from gpmodel.selection.waves import waves_left
from gpmodel.table.bundles import sharing


def select(
    calibration: Calibration,
    poses: Poses,
    offering: Offering,
    *,
    criteria: Criteria | None = None,
    seed: int = 0,
    workers: Workers = ALONE,
) -> Selection:
    """Choose the groups that the marginal likelihood wants beside the calibration's own effects.

    Free functions are looked for in what the geometry leaves, they and waves in what stepwise selection leaves of that,
    and once more in what the choice of all these leaves: a ripple may hide behind two others.
    poses: those the calibration was fitted to. criteria: limits of the choice and the number of permuted residuals that
    the groups are scored on; seed: of their order. workers: of the searches for waves and for free functions.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _select(calibration, poses, offering, criteria or Criteria(), seed, workers)


def _select(
    calibration: Calibration, poses: Poses, offering: Offering, criteria: Criteria, seed: int, workers: Workers
) -> Selection:
    use = np.ones(len(poses), dtype=bool)
    use[calibration.outliers] = False
    bundle = sharing(poses.dataset)
    screening = Screening(Shapes(_predicted_states(calibration, poses)), criteria)
    base = geometry_groups(calibration.model.effects)
    fitting = Fitting(calibration.model, poses, use, calibration.rotation_weight, bundle)
    theta, placement = calibration.theta, calibration.placement
    ratio = pose_ratio(fitting.at(theta, placement), bundle, 0.0, float(len(theta)))
    state = Expansion(replace(fitting, ratio=ratio), theta, placement, calibration.sigma)
    single = singles(offering, calibration.model.mechanism, screening.shapes)
    free = _free(left_by(screening, base, state), offering)
    among = Among(screening, base, tuple(single), tuple(free), offering.grids, seed)
    groups = among.groups(calibration.model.mechanism)
    state = added(screening, groups, state)
    left = left_by(screening, [g for g in groups if g.always_included or g.name in state.variances], state)
    chosen = _selected(_with_more(among, left, offering, workers), state)
    if chosen.state.variances.keys() == state.variances.keys():
        return chosen
    more = _with_more(chosen.among, chosen.look.active, offering, workers)
    return _selected(more, chosen.state) if more.found != chosen.among.found else chosen


def _with_more(among: Among, left: Active, offering: Offering, workers: Workers) -> Among:
    """With the free functions and waves that what is left asks for."""
    waves, free = called(workers, [partial(waves_left, left, offering.grids), partial(_free, left, offering)])
    names = {g.name for g in (*among.single, *among.found)}
    return replace(among, found=(*among.found, *(g for g in (*waves, *free) if g.name not in names)))


def select_again(before: Selection, offering: Offering, laws: Mapping[tuple[str, ...], Candidate]) -> Selection:
    """Choose once more from where a choice ended, beside what it was offered and is still wanted.

    laws: by the names of the kept groups that each stands for, in whose places the choice begins with it; they are
    among what `offering` builds. Groups come and go as in any choice.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        among, state = before.among, before.state
        new = singles(offering, state.fitting.model.mechanism, among.screening.shapes)
        single, found = ([g for g in groups if offering.wanted(g)] for groups in (among.single, among.found))
        among = replace(among, single=tuple(without_copies([*single, *new])), found=tuple(found))
        said = {name for names in laws for name in names}
        variances = {name: a for name, a in state.variances.items() if name not in said}
        instead = {law.name: max(state.variances[name] for name in names) for names, law in laws.items()}
        return _selected(among, replace(state, variances=variances | instead))


def _selected(among: Among, state: Expansion) -> Selection:
    """What is chosen of groups from a state on."""
    return summarised(among, looked(among.screening, among.groups(state.fitting.model.mechanism), state))


def _predicted_states(calibration: Calibration, poses: Poses) -> States:
    """The states of poses, the instrument looking at where the model has them.

    Where it measured them is no input: a column that holds the noise, and lengths that take the arm away, explain it.
    """
    there = resolved(calibration, poses)
    observed = observe(calibration.model, there, calibration.theta, calibration.placement)
    if there.states.seen is None:
        return there.states
    points = there.states.seen.points.copy()
    points[slice(None) if there.states.rows is None else there.states.rows] = observed.tip[:, :3, 3]
    return replace(there.states, seen=replace(there.states.seen, points=points))


def _free(left: Active, offering: Offering) -> list[Group]:
    """The free functions that what a model leaves asks for."""
    if not offering.inputs:
        return []
    return [group for group in surfaces_left(left, offering.sites, offering.inputs) if offering.wanted(group)]
