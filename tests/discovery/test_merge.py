"""One group in the place of several, and what a name is worth while groups are chosen."""

from dataclasses import replace

import numpy as np
from effect_cases import NOISE, measure, mechanism
from group_cases import ARM, STANDING

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.noise import blocks_of
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.selection.active import Active
from gpmodel.discovery.selection.group import Shapes, geometry_groups, group_of
from gpmodel.discovery.selection.merge import merged
from gpmodel.discovery.selection.moves import pruned, reestimated
from gpmodel.discovery.selection.pool import GroupPool
from gpmodel.discovery.selection.rows import Rows
from gpmodel.discovery.selection.standing import offered
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.geometric import geometric_effects
from gpmodel.table.bundles import replicates


def at_one_place() -> tuple[Active, dict[str, int]]:
    """Joint 3 winds up past its torque: what it truly does beside groups of the catalogue, one after the other in."""
    arm = mechanism(ARM)
    truth = measure(ARM, [drive_effect("true", arm.joints[2], Expression("tanh(torque_J3/400)"))], [1e-3], 5)
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses)
    shapes = Shapes(truth.poses.states)
    true = group_of("true", truth.model.effects[-1:], 3.0, shapes, family="windup")
    named = [g for g in offered(STANDING, arm, shapes) if g.place == "J3.moving Ry"]
    assert true is not None
    assert true.place == "J3.moving Ry"
    linear = linearise(fit.model, truth.poses, fit.theta, fit.placement, 1.0, np.ones(len(truth.poses), bool))
    noise = blocks_of(linear, replicates(truth.poses.dataset))
    groups = [*geometry_groups(fit.model.effects), *named, true]
    rows = Rows(arm, linear, linear.residual + linear.columns[:, linear.placement :] @ fit.theta, noise, shapes)
    active = Active(GroupPool(rows, groups, Criteria()), {}, {}, NOISE**2)
    for g in range(len(geometry_groups(fit.model.effects))):
        active = active.added(g, 1e-6)
    return active, {g.name: i for i, g in enumerate(groups)}


def test_one_group_takes_the_place_of_several_at_its_place_where_it_explains_what_they_do() -> None:
    active, number = at_one_place()
    several = ["joint compliance, J3", "error curve of the angle, J3", "hardening stiffness, J3"]
    for name in several:
        active = active.added(number[name], 1e-7)
    active = pruned(reestimated(active))
    assert {number[name] for name in several} <= set(active.variances)
    one = merged(active)
    assert set(one.variances) - set(active.variances) == {number["true"]}
    assert not {number[name] for name in several} & set(one.variances)
    assert one.evidence > active.evidence
    assert merged(one) is one


def test_a_group_without_a_name_costs_the_head_start_of_named_ones() -> None:
    active, number = at_one_place()
    pool = active.pool
    unnamed = replace(pool.groups[number["true"]], family="")
    both = GroupPool(pool.rows, [*pool.groups, unnamed], pool.criteria)
    assert both.cost[-1] - both.cost[number["true"]] == Criteria().head_start
    assert unnamed.cost == pool.groups[number["true"]].cost
