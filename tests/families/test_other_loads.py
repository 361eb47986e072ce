"""Test that compliances hold for the declared loads."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, mechanism

import gpmodel as gp
from gpmodel.model.error_model import prepare


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("effect", "column", "said"),
    [("joint_compliance J3", "", True), ("gear_harmonic J4", "", False), ("joint_compliance J3", "torque_J3", False)],
)
def test_a_compliance_is_stated_for_the_masses_unless_torques_are_measured(
    effect: str, column: str, said: bool
) -> None:
    data = bare("irb6400r", 60, 3)
    made = gp.simulate(gp.load_mechanism("irb6400r"), poses=60, seed=3).table
    torque = prepare(mechanism("irb6400r"), data).states["torque_J3"] if column else np.zeros(60)
    extras = {column: torque} if column else {}
    table = replace(made, extras=extras, extra_units=dict.fromkeys(extras, "N*m"))
    hidden = gp.calibrate("irb6400r", table, effects=[effect], holdout=0.0).record.hidden
    assert any("masses of the description" in text for text in hidden) == said
