"""A choice that goes on from where another ended: laws in the places of curves, and what is not wanted any more."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure
from group_cases import ARM, offering

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, effect_at
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.group import Group
from gpmodel.selection.offers import Offering, of_evolved
from gpmodel.selection.result import Selection
from gpmodel.selection.select import select, select_again

CURVE, BLOCK = "error curve of the angle, J3", "joint compliance, several joints"
SPRINGS = "joint compliance, J2", "compliance of J3 under the torque of J2"
"""Of the second joint's bearing, which does not turn the third as its drive would."""


def on(joint: str, axis: str, text: str) -> Effect:
    return effect_at(f"{text} on {joint}.moving {axis}", f"{joint}.moving", axis, Expression(text))


LAW = Candidate("exp(-4*square(J3)) on J3.moving Ry", (on("J3", "Ry", "exp(-4*square(J3))"),), "", 15.0, "evolved")


@cache
def first() -> tuple[Selection, Offering]:
    """A bump of the third joint's angle, for which a curve stands, and a second joint whose bearing gives way."""
    effects = (LAW.effects[0], on("J2", "Ry", "torque_J2"))
    truth = measure(ARM, effects, np.array([8e-4, 6e-8]), 4, dataset=bare(ARM, 90, 4, payload=False))
    arm, poses = truth.model.mechanism, truth.poses
    among = offering(arm, poses)
    return select(calibrate(ErrorModel(arm, geometric_effects(arm)), poses), poses, among), among


def names(selection: Selection) -> set[str]:
    return {kept.group.name for kept in selection.kept}


def test_a_law_takes_the_place_of_its_curve_and_the_rest_stays() -> None:
    before, _ = first()
    assert names(before) == {CURVE, *SPRINGS}
    law = Offering([of_evolved([LAW], lambda nodes: 2.0 * nodes)], wanted=lambda group: group.name != CURVE)
    after = select_again(before, law, {(CURVE,): LAW})
    assert names(after) == {LAW.name, *SPRINGS}
    assert after.evidence > before.evidence
    assert after.likelier_by(before) == after.evidence - before.evidence
    again = select_again(before, Offering(()), {})
    assert names(again) == names(before)
    assert again.evidence == pytest.approx(before.evidence, abs=0.1)


def test_a_law_that_says_nothing_goes_and_its_curve_comes_back_where_it_may() -> None:
    before, _ = first()
    idle = replace(LAW, name="sin(9*J1) on J3.moving Ry", effects=(on("J3", "Ry", "sin(9*J1)"),))
    after = select_again(before, Offering([of_evolved([idle], lambda nodes: 2.0 * nodes)]), {(CURVE,): idle})
    assert names(after) == names(before)
    assert after.evidence == pytest.approx(before.evidence, abs=0.5)


def test_of_a_block_that_lost_a_part_the_others_are_left() -> None:
    before, among = first()
    groups = {group.name: group for group in before.look.active.pool.groups}
    lost = "joint compliance, J5"
    terms = frozenset(e.terms for e in groups[BLOCK].effects)
    state = replace(before.state, variances={**before.state.variances, BLOCK: 1e-8}, left={BLOCK: terms})
    seen: list[str] = []

    def wanted(group: Group) -> bool:
        seen.append(group.name)
        return group.name != lost

    after = select_again(
        replace(before, look=replace(before.look, state=state)), replace(among, single=(), wanted=wanted), {}
    )
    assert lost in seen
    left = {group.name: group for group in after.look.active.pool.groups}
    assert lost not in left
    assert {part.name for part in left[BLOCK].parts} == {part.name for part in groups[BLOCK].parts} - {lost}
    assert names(after) == names(before)


def test_what_chance_finds_is_asked_when_it_is_wanted_and_the_same_each_time() -> None:
    before, _ = first()
    assert "by_chance" not in vars(replace(before))
    np.testing.assert_array_equal(replace(before).by_chance, before.by_chance)
    assert before.by_chance.max() < 5.0
