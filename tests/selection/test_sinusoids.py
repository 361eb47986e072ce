"""Test sinusoids at any rate: gain, price, and names of simulated ripples."""

import re
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized
from group_cases import ARM, STANDING, problem

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.families import catalogue
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.group import Price, group_of
from gpmodel.selection.offers import Offering
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.posterior import Active
from gpmodel.selection.scan import Scan
from gpmodel.selection.select import select
from gpmodel.selection.sinusoids import grids_of, sinusoid_null, spectrum


def grids(arm: str, family: str = "transmission_ripple") -> list[FrequencyGrid]:
    states = prepare(mechanism(arm), bare(arm, 20, 1, payload=False)).states
    found = grids_of(catalogue.catalogue, mechanism(arm), states)
    return [grid for grid in found if grid.template.family == family]


def test_a_wave_is_worth_what_its_group_is() -> None:
    active, _ = problem()
    rows = active.pool.rows
    for grid in grids(ARM)[1:4] + grids(ARM, "mesh_compliance")[1:3]:
        there = spectrum(active, grid, rows.target[:, None])
        for rate in (7.0, 101.37, 250.5):
            group = group_of(grid.at(rate), rows.shapes)
            assert group is not None
            pool = GroupPool(rows, [*active.pool.groups, replace(group, spreads=(1.0, 1.0))], Price())
            beside = Active(pool, active.variances, active.chosen, active.sigma2)
            assert there.gain(rate) == pytest.approx(Scan(beside).gains()[0][-1], rel=1e-6, abs=1e-9)


def test_waves_of_noise_are_worth_nothing_once_all_rates_are_paid_for() -> None:
    active, _ = problem()
    noise = np.random.default_rng(1).normal(0, np.sqrt(active.sigma2), (len(active.pool.rows.target), 400))
    assert np.mean(sinusoid_null(active, grids(ARM), active.pool.rows.clean(noise)) > 0.0) < 0.05


@pytest.mark.parametrize(
    ("family", "rate"),
    [
        ("transmission_ripple", 37.42),
        *(pytest.param("transmission_ripple", rate, marks=pytest.mark.long) for rate in (101.4, 160.0)),
        *(pytest.param("mesh_compliance", rate, marks=pytest.mark.long) for rate in (50.79, 101.4)),
    ],
)
def test_a_ripple_at_any_number_per_turn_is_found_and_named(family: str, rate: float) -> None:
    data = bare(ARM, 90, 5, payload=False)
    everything = [*grids(ARM), *grids(ARM, "mesh_compliance")]
    ripple = grids(ARM, family)[1].at(rate).effects
    truth = measure(ARM, ripple, sized(ARM, ripple, data, 0.1), 5, dataset=data)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    fit, prices = calibrate(model, truth.poses), Price(Criteria(shuffles=9))
    selection = select(fit, truth.poses, Offering(STANDING, grids=everything), prices=prices)
    (kept,) = selection.kept
    said = re.fullmatch(rf"{family.replace('_', ' ')}, ([\d.]+) per turn, (\w+)", kept.group.name)
    assert said
    assert float(said[1]) == pytest.approx(rate, abs=0.2)
    assert said[2] == grids(ARM, family)[1].joint.name
