"""A payload hangs at the tool point, which a first fit finds."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.payload import hang_payload
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import prepare

CHOICE = MechanismChoice("irb6400r")


def test_the_payload_hangs_where_registration_and_tool_alone_put_the_point() -> None:
    truth = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1))
    choice, arm, poses = hang_payload(CHOICE, mechanism("irb6400r"), truth.poses)
    assert choice.payload_com == pytest.approx(truth.placement.tool[""][:3, 3], abs=1e-4)
    there = mechanism("irb6400r").loads(truth.poses.dataset.q, truth.poses.dataset.payload)["torque_J5"]
    assert np.abs(poses.states["torque_J5"] - there).max() > 1.0
    again = choice.load().loads(poses.dataset.q, poses.dataset.payload)["torque_J5"]
    np.testing.assert_allclose(poses.states["torque_J5"], again)
    assert arm.name == "irb6400r"
    assert CHOICE.payload_com is None


@pytest.mark.parametrize("kind", ["nothing carried", "centre given"])
def test_nothing_changes_where_nothing_is_carried_or_its_centre_was_given(kind: str) -> None:
    truth = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1))
    choice, poses = replace(CHOICE, payload_com=(0.0, 0.0, 0.1)), truth.poses
    if kind == "nothing carried":
        choice = CHOICE
        poses = prepare(mechanism("irb6400r"), replace(poses.dataset, payload=np.zeros(60)))
    same, arm, untouched = hang_payload(choice, mechanism("irb6400r"), poses)
    assert same is choice
    assert untouched is poses
    assert arm is mechanism("irb6400r")
