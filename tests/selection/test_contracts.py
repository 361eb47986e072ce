"""Test that the selection of groups does not depend on its start and order."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, reduce
from itertools import combinations

import numpy as np
import pytest
from effect_cases import Truth, measure
from group_cases import ARM, started
from instances import some

from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import prepare
from gpmodel.selection.group import Shapes, group_of
from gpmodel.selection.posterior import Active
from gpmodel.selection.result import summarised
from gpmodel.selection.sparse_bayes import exchange as select
from gpmodel.selection.sparse_bayes import reestimate

COST = 4.0
OFFERED = {
    "line": ("J3.moving Ry", "J3"), "wave": ("J3.moving Ry", "sin(J3)", "cos(J3)"),
    "twice": ("J3.moving Ry", "sin(2*J3)", "cos(2*J3)"), "thrice": ("J3.moving Ry", "sin(3*J3)", "cos(3*J3)"),
    "hinge": ("J3.moving Ry", "max(J3, 0.2)"), "torque": ("J2.moving Ry", "torque_J2/1800"),
    "shoulder": ("J2.moving Ry", "sin(J2)", "cos(J2)"), "tilt": ("base Ry", "torque_J2/1800"),
    "cube": ("J2.moving Ry", "torque_J2/1800*square(torque_J2/1800)"), "waist": ("J1.moving Rz", "sin(J1)", "cos(J1)"),
    "wrist": ("J4.moving Rx", "sin(2*J4)", "cos(2*J4)"), "coupling": ("J5.moving Ry", "J4"),
    "forearm": ("J4.moving Rx", "J4"), "product": ("J5.moving Ry", "sin(J2)*cos(J4)"),
}  # fmt: skip
"""Site and basis functions of every group on offer."""
UNREAD = ("J1.moving Rz", "temperature")
"""Inputs and sites of temperatures without influence."""


@dataclass(frozen=True)
class Instance:
    """planted: mrad of each basis function of a group. recovered: whether the selection has exactly these groups."""

    planted: dict[str, float]
    poses: int = 60
    seed: int = 1
    recovered: bool = True


INSTANCES = {
    "nothing": Instance({}),
    "two at one site": Instance({"line": 0.3, "wave": 0.2}, 90, recovered=False),
    "three at one site": Instance({"line": 0.3, "hinge": 0.5, "twice": 0.1}, 90, recovered=False),
    "a tilt beside a wave": Instance({"tilt": 0.2, "shoulder": 0.2}, 90),
    "hardening": Instance({"torque": 0.3, "cube": 0.2}, 90),
    "four": Instance({"tilt": 0.2, "waist": 0.1, "wrist": 0.3, "coupling": 0.3}, 90, 3),
    "weak": Instance({"waist": 0.01, "torque": 0.03, "wrist": 0.03}, 90, 5, recovered=False),
    "few poses": Instance({"product": 0.5, "wave": 0.2}, 30, 4, recovered=False),
}
DIGITS = 0.1
"""Nats: twice the rise of the evidence that ends a re-estimation."""


def names(model: Active) -> set[str]:
    """Names of the selected groups."""
    return {model.pool.groups[g].name for g in model.found}


def candidate(name: str, site: str, *bases: str) -> Candidate:
    """A candidate with an unknown for each basis function."""
    slot, axis = site.split()
    effects = tuple(effect_at(f"{name} {k}", slot, axis, Expression(b)) for k, b in enumerate(bases))
    return Candidate(name, effects, "known", COST)


@cache
def truth(planted: tuple[tuple[str, float], ...], poses: int, seed: int) -> Truth:
    """A robot with geometric errors, the planted effects and noise."""
    effects = [(e, size) for name, size in planted for e in candidate(name, *OFFERED[name]).effects]
    return measure(ARM, [e for e, _ in effects], [1e-3 * size for _, size in effects], seed, count=poses)


@cache
def problem(name: str, permuted: bool = False, useless: tuple[Candidate, ...] = ()) -> tuple[Active, dict[str, int]]:
    """The geometry of an instance and the numbers of the groups on offer. permuted: groups and poses are."""
    instance, rng = INSTANCES[name], np.random.default_rng(3)
    made = truth(tuple(instance.planted.items()), instance.poses, instance.seed)
    offered = [*(candidate(name, *there) for name, there in OFFERED.items()), *useless]
    if permuted:
        poses = prepare(made.model.mechanism, made.poses.dataset.subset(rng.permutation(instance.poses)))
        made = replace(made, poses=poses)
        offered = [offered[k] for k in rng.permutation(len(offered))]
    shapes = Shapes(made.poses.states)
    return started(made, [group for group in (group_of(one, shapes) for one in offered) if group is not None])


def begun(name: str, selected: Sequence[str]) -> Active:
    """The model that a selection begins with."""
    active, number = problem(name)
    for group in selected:
        active = active.added(number[group], 1e-8)
    return active


@cache
def ended(name: str, start: str) -> Active:
    """The model at which a selection ends."""
    return select(begun(name, STARTS[start](INSTANCES[name])))


STARTS: dict[str, Callable[[Instance], list[str]]] = {
    "nothing": lambda _: [],
    "truth": lambda instance: [*instance.planted],
    "all but the truth": lambda instance: [name for name in OFFERED if name not in instance.planted],
    "all": lambda _: [*OFFERED],
    "half": lambda _: [*OFFERED][::2],
}
"""Groups in the model at which a selection begins."""
every = pytest.mark.parametrize("name", some(INSTANCES, "nothing", "three at one site", "hardening", "few poses"))


@every
@pytest.mark.parametrize("start", STARTS)
def test_the_utility_is_no_smaller_than_where_the_selection_begins(name: str, start: str) -> None:
    assert ended(name, start).utility >= begun(name, STARTS[start](INSTANCES[name])).utility


@every
@pytest.mark.parametrize("start", STARTS)
def test_every_start_ends_at_one_model(name: str, start: str) -> None:
    assert names(ended(name, start)) == names(ended(name, "nothing"))
    assert ended(name, start).utility == pytest.approx(ended(name, "nothing").utility, abs=DIGITS)


@pytest.mark.parametrize("name", [name for name, instance in INSTANCES.items() if instance.recovered])
def test_the_planted_groups_are_selected_and_no_others(name: str) -> None:
    assert names(ended(name, "nothing")) == set(INSTANCES[name].planted)


@every
def test_nothing_changes_in_what_was_selected(name: str) -> None:
    assert names(select(ended(name, "nothing"))) == names(ended(name, "nothing"))


@every
def test_the_order_of_groups_and_of_poses_changes_nothing(name: str) -> None:
    model = select(problem(name, permuted=True)[0])
    assert names(model) == names(ended(name, "nothing"))
    assert model.utility == pytest.approx(ended(name, "nothing").utility, abs=1e-3)


@every
def test_a_group_without_influence_changes_nothing(name: str) -> None:
    """A shape of temperatures that the robot does not feel, and a copy of a group at a higher price."""
    selected = names(ended(name, "nothing"))
    copy = replace(candidate("copy", *OFFERED[min(selected, default="line")]), cost=COST + 3.0)
    model = select(problem(name, useless=(candidate("cold", *UNREAD), copy))[0])
    assert names(model) == selected
    assert model.utility == pytest.approx(ended(name, "nothing").utility, abs=DIGITS)


SHARED = {
    "a": ("J3.moving Ry", "J3"), "b": ("J3.moving Ry", "sin(J3)"), "c": ("J3.moving Ry", "cos(J3)"),
    "ab": ("J3.moving Ry", "J3", "sin(J3)"), "bc": ("J3.moving Ry", "sin(J3)", "cos(J3)"),
    "abc": ("J3.moving Ry", "J3", "sin(J3)", "cos(J3)"), "d": ("J2.moving Ry", "sin(J2)"),
}  # fmt: skip
"""Site and basis functions of groups that share effects."""


@cache
def sharing(planted: tuple[float, float, float]) -> tuple[Active, dict[str, int]]:
    """A robot with some mrad of J3, sin(J3) and cos(J3), and the groups that share these effects."""
    effects = candidate("planted", *SHARED["abc"]).effects
    made = measure(ARM, effects, [1e-3 * size for size in planted], 2, count=80)
    shapes = Shapes(made.poses.states)
    groups = [group_of(candidate(name, *there), shapes) for name, there in SHARED.items()]
    return started(made, [group for group in groups if group is not None])


@pytest.mark.parametrize("planted", [(0.3, 0.0, 0.0), (0.3, 0.03, 0.02), (0.1, 0.1, 0.1), (0.0, 0.3, 0.2)])
def test_groups_that_share_effects_end_no_lower_than_the_best_disjoint_ones(planted: tuple[float, ...]) -> None:
    active, number = sharing(planted)
    every = [some for count in range(4) for some in combinations([*SHARED], count)]
    disjoint = [some for some in every if len(set("".join(some))) == len("".join(some))]
    begun = [reduce(lambda model, name: model.added(number[name], 1e-8), some, active) for some in disjoint]
    assert select(active).objective > max(reestimate(one).objective for one in begun) - DIGITS


@pytest.mark.parametrize("seed", range(8))
def test_an_effect_belongs_to_one_selected_group_with_all_of_its_prior_variance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, number = sharing((0.3, 0.1, 0.0))
    for name in rng.permutation([*SHARED])[: rng.integers(1, len(SHARED) + 1)]:
        model = model.added(number[name], 10.0 ** rng.uniform(-9, -7))
    pool = model.pool
    result = summarised(None, model, None)  # type: ignore[arg-type]
    priors = [(e.terms, e.prior**2) for kept in result.kept for e in kept.effects]
    expected: dict[object, float] = defaultdict(float)
    for g in model.found:
        for effect in pool.groups[g].with_prior(model.variances[g]):
            expected[effect.terms] += effect.prior**2
    assert len(priors) == len(expected)
    assert dict(priors) == pytest.approx(expected)
    gains = [model.gains[number[kept.group.name]][0] for kept in result.kept]
    assert gains == sorted(gains, reverse=True)
    for kept in result.kept:  # what it lost, a group of larger gain has
        lost = {e.terms for e in pool.groups[number[kept.group.name]].effects} - {e.terms for e in kept.group.effects}
        stronger = {e.terms for k, gain in zip(result.kept, gains, strict=True) if gain > kept.gain for e in k.effects}
        assert lost <= stronger
