"""A payload hangs at the tool point, which a first fit finds."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure

from gpmodel.calibration.payload import hang_payload
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.model.error_model import prepare

ARM = MechanismChoice("irb6400r").load()


def test_the_payload_hangs_where_registration_and_tool_alone_put_the_point() -> None:
    truth = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1))
    arm, poses = hang_payload(ARM, truth.poses)
    assert isinstance(arm, LoadedMechanism)
    assert arm.choice.payload_com == pytest.approx(truth.placement.tool[""][:3, 3], abs=1e-4)
    there = ARM.loads(truth.poses.dataset.q, truth.poses.dataset.payload)["torque_J5"]
    assert np.abs(poses.states["torque_J5"] - there).max() > 1.0
    again = arm.choice.load().loads(poses.dataset.q, poses.dataset.payload)["torque_J5"]
    np.testing.assert_allclose(poses.states["torque_J5"], again)
    assert ARM.choice.payload_com is None


@pytest.mark.parametrize("kind", ["nothing carried", "centre given", "built in Python"])
def test_nothing_changes_where_nothing_is_carried_or_its_centre_is_known(kind: str) -> None:
    poses = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1)).poses
    arm = {"centre given": ARM.carrying_at((0.0, 0.0, 0.1)), "built in Python": ARM.bare}.get(kind, ARM)
    if kind == "nothing carried":
        poses = prepare(ARM, replace(poses.dataset, payload=np.zeros(60)))
    same, untouched = hang_payload(arm, poses)
    assert same is arm
    assert untouched is poses
