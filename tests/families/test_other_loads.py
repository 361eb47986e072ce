"""Compliances hold for the declared loads; a later table with another mass at the tool."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, mechanism

import gpmodel as gp
from gpmodel.model.error_model import prepare
from gpmodel.table.dataset import Dataset


def carrying(data: Dataset, kilograms: float) -> Dataset:
    return replace(data, payload=np.full(len(data), kilograms), payload_given=True)


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


@pytest.mark.parametrize("kilograms", [0.0, 40.0])
def test_verify_names_a_mass_at_the_tool_that_the_later_table_does_not_declare(kilograms: float) -> None:
    arm, weak = gp.load_mechanism("irb6400r"), ["joint_compliance J2=1e-6", "joint_compliance J3=2e-6"]
    both = gp.simulate(arm, weak, poses=160, seed=4, noise="0.02 mm", inputs={"payload [kg]": f"0|{kilograms:g}"}).table
    loaded = np.flatnonzero(both.payload == kilograms)[-30:]
    empty = np.setdiff1d(np.flatnonzero(both.payload == 0.0), loaded)
    model = gp.calibrate(arm, carrying(both.subset(empty), 0.0), effects=["joint_compliance"], holdout=0.0).model
    record = gp.verify(model, carrying(both.subset(loaded), 0.0)).record
    if kilograms:
        (change,) = record.changes
        assert change.name == "mass at the tool"
        assert change.value == pytest.approx(kilograms, abs=3.5 * change.stderr)
    else:
        assert (record.verdict, record.changes) == ("holds", ())
