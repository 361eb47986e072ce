"""Test the standard errors of the constants inside a formula and of its coefficient."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.refinement import inner_changes, moved
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import catalogue
from gpmodel.families.inner import lag_constants, law_name
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, Poses, prepare

TRUE = 0.5


def law(text: str, family: str = "") -> Candidate:
    return Candidate(
        text, (effect_at(text, "J3.moving", "Ry", Expression(text), "rad", family),), family, 4.0, "sequence"
    )


def fitted(written: float, seed: int, family: str = "") -> tuple[Calibration, Poses, Candidate]:
    """A robot with 1 mrad of tanh((J3 - 0.2) / TRUE), fitted with another width."""
    planted = law(f"tanh((J3 - 0.2)/{TRUE})").effects
    truth = measure("irb6400r", planted, [1e-3], seed, dataset=bare("irb6400r", 60, seed, payload=False), geometry=0.0)
    candidate = law(f"tanh((J3 - 0.2)/{written})", family)
    model = ErrorModel(truth.model.mechanism, candidate.effects)
    return calibrate(model, truth.poses, robust=False), truth.poses, candidate


def theta_of(fit: Calibration, candidate: Candidate) -> list[float]:
    names = [e.name for e in fit.model.effects]
    return [float(fit.theta[names.index(e.name)]) for e in candidate.effects]


def with_changes(fit: Calibration, poses: Poses, candidate: Candidate) -> Calibration:
    changes = inner_changes(candidate, theta_of(fit, candidate), poses.states)
    model = ErrorModel(fit.model.mechanism, (*fit.model.effects, *(c.effect for c in changes)))
    return calibrate(model, poses, start=fit, robust=False)


@pytest.mark.long
def test_a_width_is_corrected_and_its_deviation_is_right() -> None:
    scores = []
    for seed in range(20):
        fit = with_changes(*fitted(0.52, seed))
        names = [e.name.rsplit(" ", 1)[1] for e in fit.model.effects]
        at = names.index("0.52")
        scores.append((0.52 + fit.theta[at] - TRUE) / fit.stderr[at])
        assert fit.stderr[at] < 0.05
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.45)


def test_a_coefficient_is_less_certain_where_the_law_has_constants() -> None:
    fit, poses, candidate = fitted(TRUE, 1)
    assert with_changes(fit, poses, candidate).stderr[0] > fit.stderr[0]


@pytest.mark.parametrize("text", ["J3/1.7", "sin(2*J3)", "cos(3*J3)*J2/4.1"])
def test_a_scale_and_a_harmonic_have_no_change_of_their_own(text: str) -> None:
    _, poses, _ = fitted(TRUE, 2)
    assert inner_changes(law(text), [1e-3], poses.states) == ()


def test_a_named_law_without_fitted_constants_is_left_as_it_is() -> None:
    fit, poses, candidate = fitted(0.52, 3, family="thermal_growth")
    assert inner_changes(candidate, theta_of(fit, candidate), poses.states) == ()


def test_constants_move_into_the_law_and_its_name() -> None:
    fit, poses, candidate = fitted(0.52, 0)
    found = candidate
    for _ in range(3):
        fit = with_changes(calibrate(ErrorModel(fit.model.mechanism, found.effects), poses, robust=False), poses, found)
        steps = dict(zip((e.name for e in fit.model.effects), fit.theta.tolist(), strict=True))
        changes = inner_changes(found, theta_of(fit, found), poses.states)
        found = moved(found, {c.constant: c.constant.value + steps[c.effect.name] for c in changes})
    constants = found.bases[0].program.constants  # type: ignore[union-attr]
    assert constants == pytest.approx((0.2, TRUE), abs=0.05)
    assert constants != (0.2, 0.52)
    unnamed = replace(candidate, name=law_name(candidate.effects))
    by_width = {c.constant: 0.6 for c in inner_changes(unnamed, [1e-3], poses.states) if c.constant.value == 0.52}
    assert moved(unnamed, by_width).name == "tanh((J3 - 0.2)/0.6) on J3.moving Ry"


@pytest.mark.parametrize(("value", "lag"), [(-5.3, "15"), (1.0, "15"), (29.5, "29p5"), (70.0, "70")])
def test_a_lag_keeps_its_sign_whatever_the_step(value: float, lag: str) -> None:
    effects = law("lag_T_30*J3").effects
    inner = lag_constants("lag_T_30*J3", effects, lambda what, of: "min")
    assert inner is not None
    candidate = replace(law("lag_T_30*J3"), inner=inner)
    (constant,) = inner.constants
    assert moved(candidate, {constant: value}).effects[0].inputs[0] == f"lag_T_{lag}"


@pytest.mark.parametrize(
    ("name", "family", "called"), [("dh", "cyclic_error", "period"), ("ur5", "transmission_ripple", "number per turn")]
)
def test_the_number_in_a_name_is_the_fitted_constant_unless_it_is_whole(name: str, family: str, called: str) -> None:
    arm = mechanism(name)
    states = prepare(arm, bare(name, 60)).states
    grid = next(grid for f in catalogue if f.name == family for grid in f.grids(arm, states))
    fraction, whole = (own.at(own.inner) for v in (45.3, 45.0) if (own := grid.at(grid.value(v))).inner)
    (change,) = inner_changes(fraction, [1e-3, 1e-3], states)
    assert change.constant.name == called
    assert "45.12" in moved(fraction, {change.constant: 45.12}).name
    assert inner_changes(whole, [1e-3, 1e-3], states) == ()
