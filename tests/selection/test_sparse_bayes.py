"""Test that the selection finds the true groups from any start, and the prices of groups."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import permutations

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized
from group_cases import ARM, STANDING, offered, started

from gpmodel.evidence.criteria import Criteria
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import drive_effect, effect_at
from gpmodel.model.error_model import prepare
from gpmodel.selection.group import Group, Price, Shapes, group_of, joined
from gpmodel.selection.offers import Offering, of_evolved
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.posterior import Active
from gpmodel.selection.programs import laws
from gpmodel.selection.sparse_bayes import exchange, grow, prune, reestimate

LIFT, ELBOW = "shoulder_lift_joint", "elbow_joint"
BASE, WAVE, CROSS = "base compliance", f"eccentricity, 1 per turn, {LIFT}", "shoulder under the elbow's torque"


def at_one_place() -> tuple[Active, dict[str, int]]:
    """Joint 3 winds up past its torque: what it truly does beside groups of the catalogue, one after the other in; and
    a curve of several joints of which that of joint 3 is left."""
    arm = mechanism(ARM)
    truth = measure(ARM, [drive_effect("true", arm.joints[2], Expression("tanh(torque_J3/400)"))], [1e-3], 5)
    shapes = Shapes(truth.poses.states)
    true = group_of(Candidate("true", truth.model.effects[-1:], "windup", 3.0), shapes)
    assert true is not None
    assert true.where == "J3.moving Ry"
    there = [g for g in offered(Offering(STANDING), arm, shapes) if g.where == true.where]
    curve = next(g for g in there if g.name == "error curve of the angle, J3")
    return started(truth, [*there, true, joined("error curve of the angle, several joints", [curve], 5.0)])


@pytest.mark.long
@pytest.mark.parametrize("joints", ["J3", "several joints"])
def test_one_group_takes_the_place_of_several_at_its_place_where_it_explains_what_they_do(joints: str) -> None:
    active, number = at_one_place()
    several = [f"error curve of the angle, {joints}", "hardening stiffness, J3"]
    for name in several:
        active = active.added(number[name], 1e-7)
    active = prune(reestimate(active))
    assert {number[name] for name in several} <= set(active.variances)
    one = exchange(active)
    assert set(one.variances) - set(active.variances) == {number["true"]}
    assert not {number[name] for name in several} & set(one.variances)
    assert one.objective > active.objective
    assert exchange(one).variances.keys() == one.variances.keys()


def hinge(cost: float) -> Candidate:
    """Joint 3 gives way beyond half a radian, as evolved in two terms."""
    bases = ("max(J3, 0.5)", "J3")
    effects = tuple(effect_at(f"both [{k}]", "J3.moving", "Ry", Expression(b)) for k, b in enumerate(bases, 1))
    return Candidate(" and ".join(bases) + " on J3.moving Ry", effects, "", cost, "sequence")


@pytest.mark.long
def test_terms_evolved_together_are_offered_one_by_one_where_one_has_a_name() -> None:
    active, _ = at_one_place()
    arm, shapes = mechanism(ARM), active.pool.rows.shapes
    ratio = Candidate("gear ratio, J3", (replace(hinge(1.0).effects[1], family="gear_ratio"),), "gear_ratio", 4.0)

    def catalogue(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        yield group_of(ratio, shapes)

    evolved = of_evolved([hinge(20.0)], lambda nodes: 2.0 * nodes)
    together = offered(Offering([evolved]), arm, shapes)
    assert [(g.name, g.cost, g.parts) for g in together] == [(hinge(20.0).name, 20.0, ())]
    apart = offered(Offering([catalogue, evolved]), arm, shapes)
    assert [(g.name, g.cost) for g in apart] == [("gear ratio, J3", 4.0), ("max(J3, 0.5) on J3.moving Ry", 6.0)]


def test_terms_that_share_no_input_are_laws_of_their_own() -> None:
    def nats(nodes: int) -> float:
        return 2.0 * nodes

    place = "J3.moving Ry"
    texts = ("J1", "sin(J2)", "J1*J4", "J2 + J5")
    effects = tuple(effect_at(t, "J3.moving", "Ry", Expression(t)) for t in texts)
    both = Candidate(f"{' and '.join(texts)} on {place}", effects, "", 30.0, "sequence")
    found = laws(both, nats)
    assert [(law.name, law.cost) for law in found] == [
        (f"J1 and J1*J4 on {place}", 8.0), (f"sin(J2) and J2 + J5 on {place}", 10.0)
    ]  # fmt: skip
    assert {e.terms for law in found for e in law.effects} == {e.terms for e in effects}
    assert laws(found[0], nats) == (found[0],)
    bridged = replace(both, effects=(*effects, effect_at("J1*J2", "J3.moving", "Ry", Expression("J1*J2"))))
    assert laws(bridged, nats) == (bridged,)


@pytest.mark.long
def test_a_curve_gives_way_to_a_formula_with_what_grows_with_it() -> None:
    """A hinge by two that say it together, neither of them alone."""
    arm = mechanism(ARM)
    truth = measure(ARM, [effect_at("true", "J3.moving", "Ry", Expression("max(J3, 0.5) - 0.7*J3"))], [2e-3], 5)
    shapes = Shapes(truth.poses.states)
    line, law = (
        group_of(Candidate(name, (effect_at(name, "J3.moving", "Ry", Expression(basis)),), family, 3.0), shapes)
        for name, basis, family in (("line", "J3", "gear_ratio"), ("law", "max(J3, 0.5)", ""))
    )
    (curve,) = (g for g in offered(Offering(STANDING), arm, shapes) if g.name == "error curve of the angle, J3")
    active, number = started(truth, [group for group in (line, law, curve) if group is not None])
    curved = prune(reestimate(active.added(number[curve.name], 1e-7)))
    assert set(curved.variances) - set(active.variances) == {number[curve.name]}
    spelled = exchange(curved)
    assert set(spelled.variances) - set(active.variances) == {number["line"], number["law"]}
    assert spelled.objective > curved.objective


@pytest.mark.long
def test_a_group_without_a_name_costs_the_head_start_of_named_ones() -> None:
    active, number = at_one_place()
    pool = active.pool
    unnamed = replace(pool.groups[number["true"]], family="")
    both = GroupPool(pool.rows, [*pool.groups, unnamed], pool.prices)
    assert both.cost[-1] - both.cost[number["true"]] == Criteria().head_start
    assert unnamed.cost == pool.groups[number["true"]].cost


def group_at_j3(shapes: Shapes, name: str, cost: float, *bases: str) -> Group:
    """A group of a known family at joint 3."""
    effects = [effect_at(f"{name} {b}", "J3.moving", "Ry", Expression(b)) for b in bases]
    made = group_of(Candidate(name, tuple(effects), "known", cost), shapes)
    assert made is not None
    return made


def test_two_groups_take_the_place_of_a_broad_one_though_a_third_comes_before_each_of_them() -> None:
    """Two waves, which a group with a size for each of several inputs has in one of its effects, and a third nearly."""
    both = "sin(J2) + sin(3*J5)"
    truth = measure(ARM, [effect_at("true", "J3.moving", "Ry", Expression(both))], [1e-3], 5)
    group = partial(group_at_j3, Shapes(truth.poses.states))
    groups = [
        group("broad", 12.0, both, "cos(2*J6)", "sin(2*J4)"), group("nearly", 3.0, f"{both} + 0.3*sin(J4)"),
        group("one", 3.0, "sin(J2)"), group("other", 3.0, "sin(3*J5)"),
    ]  # fmt: skip
    active, number = started(truth, groups)
    broad = reestimate(active.added(number["broad"], 1e-7))
    greedy = grow(active, np.array([g for name, g in number.items() if name != "broad"]))
    assert {greedy.pool.groups[g].name for g in greedy.found} == {"nearly"}
    apart = exchange(broad)
    assert {apart.pool.groups[g].name for g in apart.found} == {"one", "other"}
    assert apart.objective > max(broad.objective, greedy.objective)


@pytest.mark.parametrize("seed", [1, 5])
def test_what_explains_it_takes_the_place_of_what_explains_it_with_less_beside_it(seed: int) -> None:
    """A tilting base turns by the shoulder's torque, which is the elbow's and a cosine of the shoulder. Where a wave of
    the shoulder hides most of that cosine, the elbow's torque at the shoulder needs a small wave beside it and the tilt
    the whole one: held to its size, the wave would keep the tilt out."""
    arm, data = mechanism("ur5"), bare("ur5", 150, seed, payload=False)
    states = prepare(arm, data).states
    pool = {c.name: c for c in catalogue.candidates(arm, states)}
    pool[CROSS] = Candidate(CROSS, (drive_effect(CROSS, arm.joints[1], Expression(f"torque_{ELBOW}")),), "", 5.0)
    waves = np.column_stack([np.sin(states[LIFT]), np.cos(states[LIFT]), np.ones(len(states))])
    apart = np.linalg.lstsq(waves, states[f"torque_{LIFT}"] - states[f"torque_{ELBOW}"], rcond=None)[0][:2]
    tilt = sized("ur5", pool[BASE].effects, data, 0.1)
    effects = [*pool[BASE].effects, *pool[WAVE].effects]
    truth = measure("ur5", effects, np.concatenate([tilt, -1.3 * tilt[0] * apart]), seed, dataset=data)

    groups = [group_of(pool[name], Shapes(truth.poses.states)) for name in (BASE, WAVE, CROSS)]
    active, number = started(truth, [g for g in groups if g is not None])
    chosen = exchange(reestimate(active.added(number[WAVE], 1e-9).added(number[CROSS], 1e-9)))
    assert {number[BASE], number[WAVE]} <= set(chosen.variances)
    assert number[CROSS] not in chosen.variances


@pytest.mark.long
def test_an_input_that_programs_refer_to_makes_what_reads_it_cheaper() -> None:
    active, number = at_one_place()
    dear = Price(of_input={"torque_J3": 2.0, "J3": -1.0})
    for name, nats in (
        ("joint compliance, J3", 2.0),
        ("error curve of the angle, J3", -1.0),
        ("geometry, angles", 0.0),
    ):
        group = active.pool.groups[number[name]]
        assert dear.to_enter(group) - Price().to_enter(group) == pytest.approx(nats)


def test_a_kind_at_several_joints_is_described_once_in_whatever_order_it_comes() -> None:
    """Further joints of a kind pay for which joint they are; alone a group pays all."""
    arm = mechanism(ARM)
    truth = measure(ARM, [effect_at("true", "J3.moving", "Ry", Expression("J3"))], [1e-3], 5)
    groups = offered(Offering(STANDING), arm, Shapes(truth.poses.states))
    active, number = started(truth, groups)
    kind = [number[f"joint compliance, {joint}"] for joint in ("J2", "J3", "J5")]
    other = number["error curve of the angle, J1"]
    (block,) = (g for g in groups if g.name == "joint compliance, several joints")
    saved = active.pool.groups[kind[0]].cost - np.log(len(block.parts))
    assert saved > 0.0

    def paid(*selected: int) -> float:
        model = active
        for g in selected:
            model = model.added(g, 1e-8)
        return model.evidence - model.objective

    alone = {g: paid(g) for g in (*kind, other)}
    assert alone == {g: active.pool.price[g] for g in (*kind, other)}
    for order in permutations(kind):
        assert paid(*order) == pytest.approx(sum(alone[g] for g in kind) - 2 * saved)
        assert active.added(order[0], 1e-8).prices[order[1]] == pytest.approx(alone[order[1]] - saved)
    assert paid(kind[0], other) == pytest.approx(alone[kind[0]] + alone[other])


def test_many_unknowns_give_way_to_plain_effects_though_others_of_many_explain_more_one_by_one() -> None:
    """A wave of J2 and one of J5, beside three groups of many unknowns that have nearly both of them each."""
    both = "sin(J2) + sin(3*J5)"
    truth = measure(ARM, [effect_at("true", "J3.moving", "Ry", Expression(both))], [1e-3], 5)
    group = partial(group_at_j3, Shapes(truth.poses.states))
    many = [
        group(f"many {k}", 14.0, f"{both} + {k / 50}*sin(J4)", f"cos({k + 2}*J6)", f"sin({k + 2}*J4)")
        for k in (0, 1, 2)
    ]
    active, number = started(truth, [*many, group("one", 4.0, "sin(J2)"), group("other", 4.0, "sin(3*J5)")])
    plain = exchange(reestimate(active.added(number["many 0"], 1e-7)))
    assert {plain.pool.groups[g].name for g in plain.found} == {"one", "other"}
