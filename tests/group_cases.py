"""A small selection of groups for the tests of the selection."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from effect_cases import NOISE, Truth, bare, measure

import gpmodel as gp
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.noise import blocks_of
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.targets import readable_inputs
from gpmodel.families import catalogue
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects, sites_of
from gpmodel.selection.group import Group, Price, Shapes, geometry_groups
from gpmodel.selection.offers import Offering, of_offers, shared_kinds, singles
from gpmodel.selection.pool import GroupPool, Rows
from gpmodel.selection.posterior import Active
from gpmodel.table.blocks import replicates

ARM = "irb6400r"
STANDING = (of_offers(catalogue.catalogue),)


def offering(arm: Mechanism, poses: Poses) -> Offering:
    """All that a selection may choose of these poses."""
    inputs = readable_inputs(poses.states, np.arange(len(poses)))[0].names
    return Offering(STANDING, sites_of(arm), inputs)


def offered(offering: Offering, arm: Mechanism, shapes: Shapes) -> list[Group]:
    """Single groups that a selection may choose of, and those of one kind at several joints as one more each."""
    single = singles(offering, arm, shapes)
    return [*single, *shared_kinds(arm, single)]


@cache
def problem(repeats: int = 2) -> tuple[Active, np.ndarray]:
    """A few groups in, on twenty poses, so many of one each; the target before whitening and projection."""
    data = bare(ARM, 20, 1, payload=False)
    data = replace(data, q=np.repeat(data.q[::repeats], repeats, axis=0))
    truth = measure(ARM, (), (), 1, dataset=data)
    arm, poses = truth.model.mechanism, truth.poses
    model = ErrorModel(arm, geometric_effects(arm))
    weighting = Weighting({}, np.ones(len(poses), bool))
    linear = linearise(model, poses, np.zeros(len(model.effects)), truth.placement, weighting)
    noise = blocks_of(linear, replicates(poses.dataset), 0.7)
    shapes = Shapes(poses.states)
    groups = [*geometry_groups(model.effects), *offered(Offering(STANDING), arm, shapes)[::40]]
    target = linear.residual + np.random.default_rng(0).normal(0, 1e-4, len(linear.residual))
    active = Active(GroupPool(Rows(arm, linear, target, noise, shapes), groups, Price()), {}, {}, 4e-10)
    for g, a in ((0, 1e-6), (1, 1e-6), (5, 1e-8), (9, 1e-9)):
        active = active.added(g, a)
    return active, target


def started(truth: Truth, groups: Sequence[Group]) -> tuple[Active, dict[str, int]]:
    """A robot's geometry in the model and groups beside it, by name."""
    arm, shapes = truth.model.mechanism, Shapes(truth.poses.states)
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses)
    linear = linearise(fit.model, truth.poses, fit.theta, fit.placement, Weighting({}, np.ones(len(truth.poses), bool)))
    noise = blocks_of(linear, replicates(truth.poses.dataset))
    geometry = geometry_groups(fit.model.effects)
    rows = Rows(arm, linear, linear.residual + linear.columns[:, linear.placement :] @ fit.theta, noise, shapes)
    active = Active(GroupPool(rows, [*geometry, *groups], Price()), {}, {}, NOISE**2)
    for g in range(len(geometry)):
        active = active.added(g, 1e-6)
    return active, {g.name: i for i, g in enumerate([*geometry, *groups])}


@cache
def bars() -> tuple[Active, Poses, Calibration]:
    """An innocent robot measured by sixty bars, its geometry in; the standard model fitted to them."""
    made = gp.simulate(ARM, poses=120, instrument="bar", geometry_sigma="0.3 mm", seed=1)
    arm, poses = made.truth.mechanism, prepare(made.truth.mechanism, made.table)
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), poses)
    linear = linearise(fit.model, poses, fit.theta, fit.placement, Weighting({}, np.ones(len(poses), bool)))
    rows = Rows(arm, linear, linear.residual, blocks_of(linear, np.arange(len(poses)), 0.0), Shapes(poses.states))
    return Active(GroupPool(rows, list(geometry_groups(fit.model.effects)), Price()), {}, {}, 9e-10), poses, fit
