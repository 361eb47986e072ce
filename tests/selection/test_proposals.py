"""Test that candidates proposed for a residual enter the next selection."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure
from group_cases import ARM, offering

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, effect_at
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.group import group_of
from gpmodel.selection.offers import Offering
from gpmodel.selection.result import Selection
from gpmodel.selection.select import select

CURVE, SPRINGS = "error curve of the angle, J3", {"joint compliance, J2", "compliance of J3 under the torque of J2"}
"""The springs are of the bearing of the second joint, which does not turn the third as its drive would."""


def on(joint: str, axis: str, text: str) -> Effect:
    return effect_at(f"{text} on {joint}.moving {axis}", f"{joint}.moving", axis, Expression(text))


LAW = Candidate("exp(-4*square(J3)) on J3.moving Ry", (on("J3", "Ry", "exp(-4*square(J3))"),), "", 15.0, "sequence")


@cache
def problem() -> tuple[Calibration, Poses, Offering]:
    """A bump of the third joint's angle, for which a curve stands, and a second joint whose bearing yields."""
    effects = (LAW.effects[0], on("J2", "Ry", "torque_J2"))
    truth = measure(ARM, effects, np.array([8e-4, 6e-8]), 4, dataset=bare(ARM, 90, 4, payload=False))
    arm, poses = truth.model.mechanism, truth.poses
    return calibrate(ErrorModel(arm, geometric_effects(arm)), poses), poses, offering(arm, poses)


def selected(*proposed: Candidate) -> Selection:
    """The selection where candidates are proposed for its residual."""
    return select(
        *problem(),
        propose=lambda chosen: (
            [g for c in proposed if (g := group_of(c, chosen.offered.screening.shapes)) is not None],
            frozenset({CURVE}),
        ),
    )


@cache
def without_proposals() -> Selection:
    return selected()


@pytest.mark.long
def test_a_formula_takes_the_place_of_its_curve_and_the_rest_stays() -> None:
    before, after = without_proposals(), selected(LAW)
    assert before.names == {CURVE, *SPRINGS}
    assert after.names == {LAW.name, *SPRINGS}
    assert after.active.utility > before.active.utility


@pytest.mark.long
def test_a_useless_proposal_changes_nothing() -> None:
    idle = replace(LAW, name="sin(9*J1) on J3.moving Ry", effects=(on("J3", "Ry", "sin(9*J1)"),))
    before, after = without_proposals(), selected(idle)
    assert after.names == before.names
    assert abs(after.active.objective - before.active.objective) < 0.5


@pytest.mark.long
def test_the_gains_by_chance_are_the_same_each_time_and_far_below_a_true_gain() -> None:
    before = without_proposals()
    name = before.kept[0].group.name
    null = before.null_without(name)
    np.testing.assert_array_equal(replace(before).null_without(name), null)
    assert null.max() < 0.5 * before.kept[0].gain
