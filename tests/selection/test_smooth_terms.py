"""Test smooth terms of one and two inputs: covariance, products, and a recovered function."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized
from group_cases import ARM, offering, problem

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.score import diagonalised
from gpmodel.evolution.variances import best
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import Site, geometric_effects, sites_of
from gpmodel.selection.group import CAP, Price
from gpmodel.selection.offers import Offering
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.posterior import Active
from gpmodel.selection.scan import Scan
from gpmodel.selection.select import select
from gpmodel.selection.smooth_terms import TYPICAL, Sines, SiteProducts, SmoothTerm, multiplied, principal


@pytest.mark.parametrize("length", [0.35, 0.6, 0.9, 1.5])
def test_the_sines_have_the_covariance_of_a_gaussian_kernel(length: float) -> None:
    u = np.linspace(-1.0, 1.0, 41)
    values = Sines.of("J1", 3.0 * u + 1.0, length).values
    covariance = values @ values.T
    wanted = np.exp(-((u[:, None] - u) ** 2) / (2 * length**2))
    assert np.abs(covariance / covariance[20, 20] - wanted).max() < 0.02


def test_its_effects_are_its_columns_at_the_measured_poses() -> None:
    active, _ = problem()
    states = active.pool.rows.shapes.states
    function = SmoothTerm.of(tuple(Sines.of(n, states[n], 0.6) for n in ("J2", "J5")))
    group = function.group(Site((("J4.moving", "Rx", 1.0),)), 3.0, active.pool.rows.shapes)
    assert group is not None
    values = np.array([s * e.terms[0].basis(states) for s, e in zip(group.spreads, group.effects, strict=True)]).T
    np.testing.assert_allclose(values, function.values(), rtol=1e-6, atol=1e-9)


def test_products_without_columns_are_those_of_the_columns() -> None:
    active, _ = problem(1)
    sites, states = sites_of(mechanism(ARM)), active.pool.rows.shapes.states
    places = SiteProducts.of(active, sites)
    for k, names in ((4, ("J2", "J3")), (17, ("J2", "torque_J5")), (30, ("J3",))):
        function = SmoothTerm.of(tuple(Sines.of(n, states[n], 0.9) for n in names))
        group = function.group(sites[k], 0.0, active.pool.rows.shapes)
        assert group is not None
        pool = GroupPool(active.pool.rows, [*active.pool.groups, group], active.pool.prices)
        wider = Active(pool, active.variances, active.chosen, active.sigma2)
        products = places.products(function.values(), active.sigma2, slice(k, k + 1))
        gained, _ = best(*diagonalised(*products), np.array([CAP]))
        assert gained[0] == pytest.approx(Scan(wider).gains()[0][-1], rel=1e-4, abs=1e-4)


def planted(law: str, place: tuple[str, str]) -> tuple[Calibration, Poses, Offering]:
    """The geometry of a robot that has a law, its poses, and what is offered."""
    data = bare(ARM, 80, 3, payload=False)
    effect = effect_at("law", *place, Expression(law))
    truth = measure(ARM, [effect], sized(ARM, [effect], data, 0.25), 3, dataset=data)
    arm, poses = truth.model.mechanism, truth.poses
    return calibrate(ErrorModel(arm, geometric_effects(arm)), poses), poses, offering(arm, poses)


@pytest.mark.long
@pytest.mark.parametrize(("law", "place", "inputs"), [
    ("max(temperature - 25, 0)*J6", ("J3.moving", "Tz"), {"J6", "temperature"}),
    ("exp(J2)*tanh(3*(J5 - 0.4))", ("J3.moving", "Rx"), {"J2", "J5"}),
])  # fmt: skip
def test_a_law_of_two_inputs_that_nobody_named_is_found_at_its_place(
    law: str, place: tuple[str, str], inputs: set[str]
) -> None:
    standard, poses, offered = planted(law, place)
    kept = select(standard, poses, offered, prices=Price(Criteria(shuffles=9))).kept
    assert set(kept[0].group.inputs) == inputs
    assert kept[0].group.where == " ".join(place)
    assert sum(set(k.group.inputs) != inputs for k in kept) == 0


@pytest.mark.long
def test_a_curve_that_is_not_wanted_is_not_offered_elsewhere() -> None:
    standard, poses, offered = planted("exp(J2)*tanh(3*(J5 - 0.4))", ("J3.moving", "Rx"))
    said = replace(offered, wanted=lambda group: set(group.inputs) != {"J2", "J5"})
    kept = select(standard, poses, said, prices=Price(Criteria(shuffles=9))).kept
    assert kept
    assert all(set(k.group.inputs) != {"J2", "J5"} for k in kept)


def test_the_screening_in_single_precision_ranks_as_in_double() -> None:
    active, _ = problem(2)
    sites, states = sites_of(mechanism(ARM)), active.pool.rows.shapes.states
    places = SiteProducts.of(active, sites)
    values = multiplied([principal(states[name][places.poses].tobytes()) for name in ("J2", "J3")])
    inner, rhs = places.products(values, active.sigma2)
    variance = TYPICAL * values.shape[1] / np.trace(inner, axis1=1, axis2=2)
    m = np.eye(values.shape[1]) + variance[:, None, None] * inner
    solved = np.linalg.solve(m, rhs[:, :, None])[:, :, 0]
    wanted = 0.5 * variance * np.sum(rhs * solved, axis=1) - 0.5 * np.linalg.slogdet(m)[1]
    np.testing.assert_allclose(places.screened(values, active.sigma2), wanted, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_term_that_the_model_absorbs_gains_nothing_and_ends_no_search(seed: int) -> None:
    """A column of two values, such as the payloads of two tools, at the tool point that each tool has of its own."""
    rng, poses = np.random.default_rng(seed), 140
    reach, second = rng.normal(size=(40, poses, 3)), rng.integers(2, size=poses)
    inner = []
    for one in reach:
        own = np.linalg.qr((one[:, :, None] * np.eye(2)[second][:, None]).reshape(-1, 2))[0].reshape(poses, 3, 2)
        sums = np.einsum("ni,nik->nk", one, own)
        inner.append(np.diag(np.sum(one**2, axis=1)) - sums @ sums.T)
    places = SiteProducts(np.arange(poses), np.array(inner), np.zeros((40, poses)))
    gains = places.screened(np.column_stack([3.0 + 19.0 * second, 2.0 - second]), 1.0)
    assert np.all(np.abs(gains) < 0.1)
