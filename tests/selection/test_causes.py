"""Test that the credible set contains the true effect in any order of candidates."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized
from group_cases import ARM, STANDING, offered, started

from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate, inside
from gpmodel.families.inner import Constant, NonlinearParameters, symbol
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect, effect_at
from gpmodel.model.error_model import prepare
from gpmodel.model.sites import sites_of
from gpmodel.numerics.interval import COVERAGE
from gpmodel.selection.causes import CredibleSet, credible_set
from gpmodel.selection.group import Shapes, group_of
from gpmodel.selection.offers import Offering
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.posterior import Active
from gpmodel.selection.sparse_bayes import grow, reestimate

PLANTED = (
    "balancing spring, J2", "axis wobble, J2 Rz", "base compliance", "coupling, J2 to J3", "joint compliance, J5",
    "eccentricity, 1 per turn, J3", "gear error, 2 per turn, J4", "hardening stiffness, J2", "gear ratio, J2",
    "coupling, J4 to J5",
)  # fmt: skip


@cache
def grown(name: str, seed: int, millimetres: float = 0.12) -> Active:
    """A robot with one catalogue effect, measured at 60 poses, and what the selection grows from the catalogue."""
    data, arm = bare(ARM, 60, seed, payload=False), mechanism(ARM)
    states = prepare(arm, data).states
    effects = {c.name: c for c in catalogue.candidates(arm, states)}[name].effects
    truth = measure(ARM, effects, sized(ARM, effects, data, millimetres, seed), seed, dataset=data)
    return grow(started(truth, offered(Offering(STANDING), arm, Shapes(truth.poses.states)))[0])


def said(found: CredibleSet) -> list[tuple[tuple[str, ...], float]]:
    """Names and probability of each cause."""
    return [(tuple(group.name for group in cause.groups), round(cause.probability, 4)) for cause in found.causes]


@pytest.mark.parametrize(
    ("name", "seed"),
    [(name, 3) if k < 1 else pytest.param(name, k, marks=pytest.mark.long) for k, name in enumerate(PLANTED)],
)
def test_the_planted_effect_is_in_a_set_that_holds_what_it_says(name: str, seed: int) -> None:
    model = grown(name, seed)
    sets = [credible_set(model, g) for g in model.found]
    assert any(name in found.names for found in sets)
    for found in sets:
        assert COVERAGE <= sum(cause.probability for cause in found.causes) + found.none <= 1.0 + 1e-9
        assert sum(cause.own for cause in found.causes) <= 1


def test_the_order_of_the_candidates_changes_nothing() -> None:
    model = grown(PLANTED[0], 3)
    order = np.random.default_rng(0).permutation(len(model.pool.groups))
    place = {int(g): k for k, g in enumerate(order)}
    pool = GroupPool(model.pool.rows, [model.pool.groups[g] for g in order], model.pool.prices)
    again = replace(
        model, pool=pool, variances={place[g]: a for g, a in model.variances.items()},
        chosen={place[g]: part for g, part in model.chosen.items()},
    )  # fmt: skip
    for g in model.found:
        assert said(credible_set(again, place[g])) == said(credible_set(model, g))


def test_causes_that_no_measurement_distinguishes_are_one_line() -> None:
    """Sag under its own weight and a spring that does not balance it follow the sine and cosine of one angle."""
    model = grown(PLANTED[0], 3)
    found = next(found for g in model.found if PLANTED[0] in (found := credible_set(model, g)).names)
    line = next(names for names, _ in said(found) if PLANTED[0] in names)
    assert len(line) > 1
    assert all(", J2" in name for name in line)


@pytest.mark.long
def test_one_kind_at_all_joints_is_no_cause_of_that_kind_at_one_joint() -> None:
    """Three compliances, which one joint group would describe at one price."""
    data, arm = bare(ARM, 60, 3, payload=False), mechanism(ARM)
    states = prepare(arm, data).states
    effects = {c.name: c for c in catalogue.candidates(arm, states)}
    names = ("joint compliance, J2", "joint compliance, J3", "joint compliance, J5")
    every = [e for name in names for e in effects[name].effects]
    size = [float(sized(ARM, (e,), data, 0.12, 3)[0]) for e in every]
    truth = measure(ARM, every, size, 3, dataset=data)
    model, number = started(truth, offered(Offering(STANDING), arm, Shapes(truth.poses.states)))
    for name in names:
        model = model.added(number[name], 1e-8)
    model = reestimate(model)
    for name in names:
        found = credible_set(model, number[name])
        assert not any("several joints" in cause for cause in found.names)
        assert next(cause.probability for cause in found.causes if cause.own) > 0.5


def test_a_cause_is_one_whatever_the_constant_inside_and_keeps_what_it_contains() -> None:
    """A ramp over torque of unknown width, offered with three widths, and with a second effect."""
    data, arm = bare(ARM, 60, 3, payload=False), mechanism(ARM)
    planted = drive_effect("ramp", arm.joints[2], Expression("tanh(torque_J3/400)"))
    truth = measure(ARM, [planted], [4e-4], 3, dataset=data)
    template = drive_effect("ramp", arm.joints[2], Expression(f"tanh(torque_J3/{symbol()})"), family="windup")
    more = drive_effect("of the angle", arm.joints[2], Expression("sin(3*J3)"))
    inner = (
        NonlinearParameters(f"ramp {symbol()}", (template,), (Constant("width", "N*m", w),)) for w in (390, 400, 410)
    )
    offers = [inside(i, "windup", 3.0) for i in inner]
    offers.append(Candidate("ramp and angle", (*offers[1].effects, more), "coupling", -1.0))
    groups = [g for g in (group_of(c, Shapes(truth.poses.states)) for c in offers) if g is not None]
    model, number = started(truth, groups)
    found = credible_set(reestimate(model.added(number["ramp 400"], 1e-7)), number["ramp 400"])
    own, other = sorted(found.causes, key=lambda cause: not cause.own)
    assert [g.name for g in own.groups] == ["ramp 400"]
    assert own.own
    assert [g.name for g in other.groups] == ["ramp and angle"]
    assert other.amount == pytest.approx(own.amount, abs=0.05)
    assert own.amount == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
def test_one_stop_operator_has_a_name() -> None:
    """Friction in one joint without a declared direction of approach; other widths would describe nothing more."""
    data, arm = bare(ARM, 60, 3, payload=False, in_order=True), mechanism(ARM)
    effect = drive_effect("stop", arm.joints[3], Expression("stop_J4_0p25/0.25"))
    truth = measure(ARM, [effect], sized(ARM, [effect], data, 0.12, 3), 3, dataset=data)
    model = grow(started(truth, offered(Offering(STANDING), arm, Shapes(truth.poses.states)))[0])
    (found,) = (credible_set(model, g) for g in model.found)
    assert found.names[0].startswith("hysteresis over its angle, J4, within")


@pytest.mark.long
def test_an_effect_that_no_family_describes_is_none_of_these() -> None:
    """A product of two angles, for which the compliance of the joint is selected by force."""
    data, arm = bare(ARM, 60, 4, payload=False), mechanism(ARM)
    effect = effect_at("product", "J3.moving", "Rz", Expression("sin(2*J2)*cos(3*J4)"))
    truth = measure(ARM, [effect], [6e-4], 4, dataset=data)
    model, number = started(truth, offered(Offering(STANDING), arm, Shapes(truth.poses.states)))
    g = number["joint compliance, J3"]
    model = reestimate(model.added(g, 1e-8))
    found = credible_set(model, g, sites_of(arm), ("J2", "J4"))
    assert found.none > COVERAGE
    assert found.causes == ()
