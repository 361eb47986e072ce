"""Test that poses at a kink or step that a smooth term rounds off are no outliers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.formulas import doubtful, explained, formulas, taken_as_measured
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects

ARM, SHARP = "irb6400r", ("max(J4 - 1.5, 0)", "abs(J4 - 0.7)", "tanh(40*(J4 - 0.7))")
GROSS = (3,)


def at_drive(name: str, *texts: str) -> Candidate:
    effects = tuple(effect_at(f"{name}, {t}", "J4.moving", "Rz", Expression(t)) for t in texts)
    return Candidate(name, effects, "", 20.0, "smooth term")


CURVE = at_drive("curve", *(f"{f}({k}*J4)" for k in (1, 2, 3) for f in ("sin", "cos")))


@cache
def beside_curve(law: str, gross: tuple[int, ...] = ()) -> Residual:
    """Ninety poses of a robot with a law, fitted with a curve; positions of some of them 20 mm off."""
    arm, effects = mechanism(ARM), at_drive("law", law).effects
    truth = measure(ARM, effects, [2e-3], 3, dataset=bare(ARM, 90, 3)).poses
    position = truth.dataset.position.copy()
    position[list(gross)] += 2e-2
    poses = prepare(arm, replace(truth.dataset, position=position))
    fit = calibrate(ErrorModel(arm, (*geometric_effects(arm), *CURVE.effects)), poses)
    return residual_of(fit, poses, Criteria(), 0)


@pytest.mark.first(2)
@pytest.mark.parametrize("gross", [(), GROSS])
@pytest.mark.parametrize("law", SHARP)
def test_what_is_sharper_than_the_curve_is_in_doubt_and_explained_by_the_law(law: str, gross: tuple[int, ...]) -> None:
    left = beside_curve(law, gross)
    doubted = doubtful(left, CURVE)
    assert 1 < doubted.sum() < 20
    assert not doubted[list(gross)].any()
    sharp = taken_as_measured(left, doubted).without(CURVE.effects)
    true, wrong = at_drive("law", law), at_drive("wrong", "sin(J4)")
    assert explained(sharp, [true])[doubted].all()
    np.testing.assert_array_equal(explained(sharp, [wrong, true]), explained(sharp, [true]))
    assert not explained(sharp, [true])[list(gross)].any()


def test_nothing_is_in_doubt_where_the_curve_says_all() -> None:
    assert not doubtful(beside_curve("sin(2*J4)", GROSS), CURVE).any()


@pytest.mark.long
@pytest.mark.parametrize("gross", [(), GROSS])
@pytest.mark.parametrize("law", SHARP)
def test_the_law_is_found_where_the_curve_had_made_outliers_of_it(law: str, gross: tuple[int, ...]) -> None:
    left = beside_curve(law, gross)
    laws = [law.candidate for law in formulas(left, [CURVE], Search(workers=2))]
    doubted = doubtful(left, CURVE)
    sharp = (taken_as_measured(left, doubted) if doubted.any() else left).without(CURVE.effects)
    nats = [score.nats for score in scores(sharp, laws)]
    basis = Expression(str(laws[int(np.argmax(nats))].effects[0].terms[0].basis))
    angle = np.linspace(-3.0, 3.0, 301)
    true, said = Expression(law)(_Angles(angle)), basis(_Angles(angle))
    design = np.column_stack([said, np.ones_like(angle)])
    left_over = true - design @ np.linalg.lstsq(design, true, rcond=None)[0]
    assert np.sqrt(np.mean(left_over**2)) < 0.02 * np.std(true)


class _Angles:
    """States of the fourth joint's angle alone."""

    def __init__(self, angle: np.ndarray) -> None:
        self.angle = angle

    def __getitem__(self, name: str) -> np.ndarray:
        return {"J4": self.angle}[name]

    def __len__(self) -> int:
        return len(self.angle)
