"""The test of the architecture: a basis and an effect nobody foresaw, defined here and used from end to end."""

from dataclasses import dataclass

import numpy as np
from effect_cases import bare, measure, mechanism

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.result import errors_on
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import best_nats, scores
from gpmodel.families.candidate import Candidate
from gpmodel.model.effect import Effect, Term, effect_at
from gpmodel.model.error_model import ErrorModel, observe
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States
from gpmodel.report.quantity import quantity, shape


@dataclass(frozen=True)
class Bump:
    """A notch in a track: exp(-(s - centre)² / 2 width²) of one column."""

    column: str
    centre: float
    width: float

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.column,)

    def __call__(self, states: States) -> Array:
        return np.exp(-0.5 * ((states[self.column] - self.centre) / self.width) ** 2)

    def __str__(self) -> str:
        return f"notch({self.column})"


NOTCH = Effect(
    "notched track",
    (Term("J3.moving", "Ry", Bump("J2", 0.3, 0.4)), Term("base", "Tz", Bump("J1", 0.0, 1.0), 0.2)),
    "rad",
)


def test_a_new_basis_is_predicted_fitted_judged_and_reported() -> None:
    truth = measure("irb6400r", (NOTCH,), (2e-3,), 21, dataset=bare("irb6400r", 90, 21, payload=False))
    train, rest = truth.poses.subset(np.arange(70)), truth.poses.subset(np.arange(70, 90))
    standard = geometric_effects(mechanism("irb6400r"))
    without = calibrate(ErrorModel(mechanism("irb6400r"), standard), train)
    candidate = Candidate("notched track", (NOTCH,), "", 4.0)
    residual = residual_of(without, train, Criteria(), 0)
    (score,) = scores(residual, [candidate])
    null = best_nats(residual, [candidate], residual.shuffled(np.random.default_rng(0), 40))
    assert score.nats > null.max() + 20
    fit = calibrate(ErrorModel(mechanism("irb6400r"), (*standard, NOTCH)), train)
    found = quantity(fit, candidate, train.states)
    assert abs(found.value - 2e-3) < 3 * found.stderr
    assert (found.basis, found.unit) == ("notch(J2)", "rad")
    np.testing.assert_allclose(shape(fit, candidate, train.states), found.value * Bump("J2", 0.3, 0.4)(train.states))
    assert np.sqrt(np.mean(errors_on(fit, rest) ** 2)) < 0.7 * np.sqrt(np.mean(errors_on(without, rest) ** 2))
    assert NOTCH.inputs == ("J2", "J1")


def test_its_columns_are_the_derivative_of_the_prediction() -> None:
    truth = measure("irb6400r", (NOTCH,), (0.0,), 22, count=9, geometry=0.0)
    ahead, behind = (observe(truth.model, truth.poses, np.array([d]), truth.placement) for d in (1e-5, -1e-5))
    seen = observe(truth.model, truth.poses, truth.theta, truth.placement)
    columns = effect_columns((NOTCH,), truth.model, truth.poses, seen)[:, :3, 0]
    np.testing.assert_allclose(columns, (ahead.tip - behind.tip)[:, :3, 3] / 2e-5, atol=1e-8)


def test_a_known_physical_effect_is_one_line() -> None:
    effect = effect_at("kinked cable", "J5.moving", "Rx", Bump("J6", 1.0, 0.3))
    assert not effect.constant
    assert effect.twist(measure("irb6400r", (), (), 1, count=4).poses.states, "J5.moving").shape == (4, 6)
