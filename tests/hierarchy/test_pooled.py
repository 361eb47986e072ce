"""Effects of a type, selected by the evidence of all its machines together."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from fleet_cases import GEOMETRY, MECHANISM, NOISE

from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.score import scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.forks import ALONE
from gpmodel.hierarchy.found import FleetSearch, Found, KeptMachines, Searched, found_on_type
from gpmodel.hierarchy.pooled import select_for_type
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import prepare
from gpmodel.planning.simulate import simulate
from gpmodel.progress import Teller, silent

POSES = 30
WEAK = "joint_compliance J2=3e-8 rad/Nm"
"""About two standard errors on one machine."""
STRONG = "joint_compliance J3=1e-6 rad/Nm"
BASE = "base_compliance=8e-8 rad/Nm"


@cache
def fleet(seed: int, effects: tuple[tuple[str, ...], ...]) -> list[Searched]:
    """One machine for each tuple of effects, all of its poses for training."""
    mechanism, rng = MechanismChoice(MECHANISM).load(), np.random.default_rng(seed)
    out = []
    for number, own in enumerate(effects):
        q = random_poses(mechanism, POSES, rng)
        made = simulate(mechanism, q, list(own), rng, noise=NOISE, geometry_sigma=GEOMETRY).dataset
        rows = np.arange(POSES), np.arange(0, POSES, 3)
        out.append(Searched(mechanism, prepare(mechanism, made), rows, number))
    return out


def named(tasks: Sequence[Searched]) -> dict[str, Candidate]:
    """The named effects of loads, which these machines have or could have instead."""
    families = {"joint_compliance", "base_compliance", "parallel_bar_closure", "joint_bending", "gear_harmonic"}
    pool = candidates(tasks[0].mechanism, tasks[0].poses.states)
    return {c.name: c for c in pool if c.family in families}


def selected(tasks: Sequence[Searched], proposals: dict[str, Candidate]) -> set[str]:
    criteria = Criteria()
    found = select_for_type(proposals, lambda some: [t.residual(some, criteria) for t in tasks], criteria, 0)
    return {c.name for c in found}


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        pytest.param(((BASE,),) * 4, {"base compliance"}, marks=pytest.mark.long),
        (((BASE,), (BASE,), (BASE, STRONG)), {"base compliance"}),
        (((), (), (STRONG,), ()), set()),
        (((),) * 4, set()),
        pytest.param(((BASE, STRONG),) * 3, {"base compliance", "joint compliance, J3"}, marks=pytest.mark.long),
    ],
)
def test_an_effect_of_the_type_is_one_that_most_machines_have(
    effects: tuple[tuple[str, ...], ...], expected: set[str]
) -> None:
    tasks = fleet(5, effects)
    assert selected(tasks, named(tasks)) == expected


@pytest.mark.long
def test_many_machines_show_what_none_shows_by_itself() -> None:
    tasks = fleet(7, ((WEAK,),) * 8)
    proposals = named(tasks)
    weak, criteria = proposals["joint compliance, J2"], Criteria()
    alone = [scores(task.residual((), criteria), [weak])[0].nats for task in tasks]
    assert sum(nats > criteria.minimum_nats for nats in alone) <= 2
    assert selected(tasks, proposals) == {"joint compliance, J2"}


@pytest.mark.long
def test_a_machine_is_asked_again_given_the_effects_of_the_type(monkeypatch: pytest.MonkeyPatch) -> None:
    """The third machine showed a rival in place of the type's effect; given that effect the rival is not asked for."""
    tasks = fleet(5, ((BASE,),) * 4)
    pool, asked = named(tasks), list[tuple[str, ...]]()
    base, rival = pool["base compliance"], pool["parallel-bar closure, J2"]

    def found(task: Searched) -> Found:
        asked.append(tuple(c.name for c in task.known))
        return Found((), True) if task.known else Found((rival if task.seed == 2 else base,), True)

    monkeypatch.setattr(Searched, "found", found)
    search = FleetSearch(list("abcd"), tasks, ALONE, KeptMachines(), Teller(silent))
    shared, own, chosen = found_on_type(search)
    assert [e.name for e in shared] == ["base compliance"]
    assert asked == [(), (), (), (), ("base compliance",)]
    assert own == ((),) * 4
    assert "base compliance on all (by itself on 3)" in chosen
