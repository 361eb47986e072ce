"""Test mean and spread between machines, and outlying machines, on simulated numbers."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fleet_cases import GEOMETRY, MECHANISM, NOISE, curved
from instances import some
from scipy import linalg, stats

import gpmodel as gp
from gpmodel.api.fleet import FleetResult
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.executor import ALONE
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.hierarchy.between import Deviations, deviations
from gpmodel.hierarchy.block import TypeDistribution, parameter_information, type_distribution
from gpmodel.hierarchy.fleet import Information, _expectation_maximisation
from gpmodel.hierarchy.found import (
    FindingsFile,
    FleetSearch,
    MachineFindings,
    MachineSearch,
    _common,
    _exchanged,
    _spectrum,
    _with_common_mean,
    found_on_type,
    pooled,
    select_for_type,
)
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import prepare
from gpmodel.numerics.interval import COVERAGE, SIGNIFICANCE, holm
from gpmodel.planning.simulate import simulate
from gpmodel.progress import Reporter, silent
from gpmodel.report.fleet import summary
from gpmodel.selection.group import Group

FLEETS, MACHINES, PARAMETERS = 30, 12, 8


def drawn(seed: int, spread: float, machines: int = MACHINES) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of machines with mean 5 and some spread, and their variances about one."""
    rng = np.random.default_rng(seed)
    variances = rng.uniform(0.5, 1.5, (machines, PARAMETERS))
    return 5.0 + rng.normal(size=variances.shape) * np.sqrt(variances + spread**2), variances


def estimate_spread(values: np.ndarray, variances: np.ndarray) -> TypeDistribution:
    return type_distribution(parameter_information(values, np.sqrt(variances)))


def judged(values: np.ndarray, variances: np.ndarray) -> Deviations:
    return deviations(
        [parameter_information(v, np.sqrt(s)) for v, s in zip(values.T, variances.T, strict=True)], len(values)
    )


@pytest.mark.first(2)
@pytest.mark.parametrize("spread", [0.0, 0.5, 2.0, 20.0])
def test_mean_and_spread_are_covered_as_often_as_they_say(spread: float) -> None:
    found = []
    for seed in range(FLEETS):
        values, variances = drawn(seed, spread)
        found += [estimate_spread(values[:, k], variances[:, k]) for k in range(PARAMETERS)]
    t = np.abs([(b.mean[0] - 5.0) / np.sqrt(b.covariance[0, 0]) for b in found])
    inside = [b.low <= spread <= b.high for b in found]
    sure = 3.0 * np.sqrt(0.05 * 0.95 / len(found))
    assert np.mean(t < stats.t.ppf(0.975, MACHINES - 1)) > COVERAGE - sure
    assert np.mean(inside) > COVERAGE - sure
    estimated = np.mean([b.spread**2 for b in found])
    assert estimated == pytest.approx(
        spread**2, abs=3.0 * (spread**2 + 1.0) * np.sqrt(2.0 / (MACHINES - 1) / len(found)) + 0.2
    )


@pytest.mark.long
@pytest.mark.parametrize("spread", some([0.0, 1.0, 10.0], 1.0))
def test_an_innocent_fleet_has_outliers_no_more_often_than_stated(spread: float) -> None:
    false = sum(not judged(*drawn(seed, spread)).inside.all() for seed in range(FLEETS))
    assert stats.binomtest(false, FLEETS, SIGNIFICANCE, alternative="greater").pvalue > 0.001


@pytest.mark.parametrize("others", [(), (3,)])
def test_planted_outliers_are_found_and_hide_no_other(others: tuple[int, ...]) -> None:
    values, variances = drawn(0, 1.0)
    values[7, 2] += 30.0
    for k in others:
        values[k, 4] -= 30.0
    found = judged(values, variances)
    assert set(zip(*np.nonzero(~found.inside), strict=True)) == {(7, 2), *((k, 4) for k in others)}
    assert found.chance[7, 2] < SIGNIFICANCE
    assert found.z[7, 2] > 0
    clean = np.delete(values[:, 2], 7)
    of = estimate_spread(clean, np.delete(variances[:, 2], 7))
    assert abs(of.mean[0] - 5.0) < 3.0 * np.sqrt(of.covariance[0, 0])


def test_of_three_machines_none_stands_out() -> None:
    values, variances = drawn(0, 1.0, machines=3)
    values[0] += 1e3
    found = judged(values, variances)
    assert isinstance(found, Deviations)
    assert found.inside.all()


def test_units_do_not_matter() -> None:
    values, variances = drawn(1, 2.0)
    large, small = (
        estimate_spread(values[:, 0], variances[:, 0]),
        estimate_spread(1e-9 * values[:, 0], 1e-18 * variances[:, 0]),
    )
    assert 1e-9 * large.spread == pytest.approx(small.spread, rel=1e-6)
    assert 1e-9 * large.high == pytest.approx(small.high, rel=1e-6)


def test_chances_corrected_for_their_number() -> None:
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03])), [0.03, 0.06, 0.06])
    np.testing.assert_allclose(holm(np.array([[0.5, 0.9]])), [[1.0, 1.0]])
    assert holm(np.zeros(0)).shape == (0,)


COUNT, ODD, CURVE = 8, 2, "joint_curve J1"


@pytest.fixture(scope="module")
def found() -> FleetResult:
    return gp.fleet(MECHANISM, curved(COUNT, ODD), [CURVE])


@pytest.mark.long
@pytest.mark.parametrize("serial", ["C-1", "C-3"])
def test_alone_a_machine_is_what_calibrate_makes_of_its_table(found: FleetResult, serial: str) -> None:
    alone = gp.calibrate(MECHANISM, curved(COUNT, ODD)[serial], [CURVE])
    machine = next(m for m in found.record.machines if m.serial == serial)
    assert machine.own_mm == pytest.approx(alone.record.ladder[-1].heldout.rms_mm, rel=1e-9)


@pytest.mark.long
def test_harmonics_have_one_row_together_and_none_alone(found: FleetResult) -> None:
    assert all(part.constant for part in found.record.effects)
    (block,) = found.record.blocks
    assert "J1" in block.name
    assert len(block.effects) == 24
    assert block.low <= block.spread <= block.high < 1.0
    assert f"{block.name}" in summary(found.record)
    rows = found.to_dataframe().query("parameter == @block.name")
    assert len(rows) == COUNT
    assert rows.value.isna().all()


@pytest.mark.long
def test_the_machine_with_another_curve_is_named_and_keeps_it(found: FleetResult) -> None:
    assert [(k, part.name) for k, part in found.record.outliers()] == [(ODD, found.record.blocks[0].name)]
    machine = found.record.machines[ODD]
    assert machine.fleet_mm < 1.2 * machine.own_mm


@pytest.mark.long
def test_a_further_machine_with_another_curve_is_said_so(found: FleetResult) -> None:
    told = gp.calibrate(MECHANISM, curved(COUNT, ODD)["C-3"], fleet=found.record, holdout=0.0)
    assert f"unlike its type in {found.record.blocks[0].name}." in told.verdict
    alike = gp.calibrate(MECHANISM, curved(COUNT, ODD)["C-1"], fleet=found.record, holdout=0.0)
    assert "unlike" not in alike.verdict


@pytest.mark.long
def test_together_the_others_are_predicted_better(found: FleetResult) -> None:
    alone, together = (
        np.array([getattr(m, name) for k, m in enumerate(found.record.machines) if k != ODD])
        for name in ("own_mm", "fleet_mm")
    )
    assert np.mean(together**2) < np.mean(alone**2)


POSES = 30
WEAK = "joint_compliance J2=3e-8 rad/Nm"
"""About two standard errors on one machine."""
STRONG = "joint_compliance J3=1e-6 rad/Nm"
BASE = "base_compliance=8e-8 rad/Nm"


@cache
def fleet(seed: int, effects: tuple[tuple[str, ...], ...]) -> list[MachineSearch]:
    """One machine for each tuple of effects, all of its poses for training."""
    mechanism, rng = MechanismChoice(MECHANISM).load(), np.random.default_rng(seed)
    out = []
    for number, own in enumerate(effects):
        q = random_poses(mechanism, POSES, rng)
        made = simulate(mechanism, q, list(own), rng, noise=NOISE, geometry_sigma=GEOMETRY).dataset
        rows = np.arange(POSES), np.arange(0, POSES, 3)
        out.append(MachineSearch(mechanism, prepare(mechanism, made), rows, number))
    return out


def named(tasks: Sequence[MachineSearch]) -> dict[str, Candidate]:
    """The named effects of loads, which these machines have or could have instead."""
    families = {"joint_compliance", "base_compliance", "parallel_bar_closure", "joint_bending", "gear_harmonic"}
    pool = candidates(tasks[0].mechanism, tasks[0].poses.states)
    return {c.name: c for c in pool if c.family in families}


def selected(tasks: Sequence[MachineSearch], proposals: dict[str, Candidate]) -> set[str]:
    criteria = Criteria()
    found = select_for_type(proposals, lambda some: [t.residual(some, criteria) for t in tasks], criteria, 0)
    return {c.name for c in found}


AGREEING = ((BASE,), (BASE,), (BASE, STRONG))


@cache
def base_group() -> tuple[list[Residual], Group]:
    """Residuals of machines whose bases yield alike, and the group of the base's compliance."""
    tasks = fleet(5, AGREEING)
    machines = [task.residual((), Criteria()) for task in tasks]
    group = _common(named(tasks)["base compliance"], machines)
    assert group is not None
    return machines, group


def test_machines_that_agree_pay_once_for_a_common_coefficient() -> None:
    """Half the machines with the opposite sign are as likely one by one, and less likely as machines of one type."""
    machines, group = base_group()
    turned = [replace(of, values=of.values * sign) for of, sign in zip(machines, (1.0, -1.0, 1.0), strict=True)]
    assert pooled(machines, group).nats > pooled(turned, group).nats + 5.0


@pytest.mark.long
def test_a_cause_that_was_selected_too_early_is_exchanged() -> None:
    tasks = fleet(5, AGREEING)
    pool = named(tasks)
    early, late, better = (
        pool[name] for name in ("parallel-bar closure, J2", "joint compliance, J3", "base compliance")
    )
    left = {better.name: better}
    found = _exchanged(
        {c.name: c for c in (early, late)}, left, lambda some: [t.residual(some, Criteria()) for t in tasks]
    )
    assert list(found) == [better.name, late.name]
    assert not left


def test_the_pooled_gain_is_the_log_evidence_of_all_rows_together() -> None:
    machines, group = base_group()
    spectra = [_spectrum(of, group, of.values[:, None]) for of in machines]
    (gain,), (own,), (mean,) = _with_common_mean(group, spectra)
    size = len(group.effects)
    s = linalg.block_diag(*(turn * s @ turn.T for s, turn, _ in spectra))
    q = np.concatenate([turn @ q[0] for _, turn, q in spectra])
    prior = np.kron(mean * np.ones((3, 3)) + own * np.eye(3), np.eye(size))
    evidence = np.eye(len(q)) + prior @ s
    assert gain == pytest.approx(0.5 * (q @ np.linalg.solve(evidence, prior @ q) - np.linalg.slogdet(evidence)[1]))


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        pytest.param(((BASE,),) * 4, {"base compliance"}, marks=pytest.mark.long),
        (AGREEING, {"base compliance"}),
        pytest.param(((), (), (STRONG,), ()), set(), marks=pytest.mark.long),
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

    def found(task: MachineSearch) -> MachineFindings:
        asked.append(tuple(c.name for c in task.known))
        return MachineFindings((), True) if task.known else MachineFindings((rival if task.seed == 2 else base,), True)

    monkeypatch.setattr(MachineSearch, "found", found)
    search = FleetSearch(list("abcd"), tasks, ALONE, FindingsFile(), Reporter(silent))
    shared, own, chosen = found_on_type(search)
    assert [e.name for e in shared] == ["base compliance"]
    assert asked == [(), (), (), (), ("base compliance",)]
    assert own == ((),) * 4
    assert "base compliance on all (by itself on 3)" in chosen


@pytest.mark.parametrize("constant", [True, False])
@pytest.mark.parametrize("sharp", [1e5, 1e8])
def test_effects_that_stand_for_one_another_stay_known_in_sum(constant: bool, sharp: float) -> None:
    rng, machines = np.random.default_rng(0), 40
    direction = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    matrix = sum(sharp * np.outer(d, d) for d in direction) * np.ones((machines, 1, 1))
    truth = np.array([0.3, 0.3, -0.5]) + 0.1 * rng.normal(size=(machines, 3))
    told = Information(matrix, np.einsum("mij,mj->mi", matrix, truth))
    mean, deviation = _expectation_maximisation(told, np.array([0, 0, 1]), np.full(3, constant))
    assert np.isfinite(deviation).all()
    assert mean[0] + mean[1] == pytest.approx(0.6, abs=3.0 * 0.15 / np.sqrt(machines))
    assert deviation[2] == pytest.approx(0.1, rel=3.0 / np.sqrt(2.0 * machines))
    assert (deviation[0] > 0.5) == (not constant)
