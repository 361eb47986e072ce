"""Test that user-defined families and effects are tested like those of the catalogue."""

from collections.abc import Iterator

import pytest
from loop_cases import QUICK, robot

from gpmodel.discovery.loop import discover
from gpmodel.errors import InputError
from gpmodel.families.candidate import Candidate, one
from gpmodel.families.catalogue import Family, catalogue
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import drive_effect
from gpmodel.model.states import States


def saturating(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    for joint in mechanism.joints:
        basis = Expression(f"tanh(torque_{joint.name}/400)")
        yield one(
            f"saturating windup, {joint.name}",
            drive_effect(f"windup {joint.name}", joint, basis, family="saturating_windup"),
            4.0,
        )


WINDUP = Family("saturating_windup", "the gear winds up and stops", "its maker", saturating)


@pytest.mark.long
def test_a_family_from_outside_is_found_and_explained() -> None:
    truth, train, heldout = robot("windup", 0)
    arm = truth.model.mechanism
    found = discover(arm, truth.poses, train, heldout, search=QUICK, candidates=(*catalogue, WINDUP))
    first = found.findings[0].candidate
    assert first.name == "saturating windup, J3"
    assert first.explanation == "the gear winds up and stops (its maker)"


def test_what_is_no_offer_is_refused_before_the_search() -> None:
    truth, train, heldout = robot("windup", 0)
    with pytest.raises(InputError, match="candidates: 3 is of type int"):
        discover(truth.model.mechanism, truth.poses, train, heldout, candidates=(3,))  # type: ignore[arg-type]
