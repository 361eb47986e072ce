"""Test later tables at temperatures and payloads outside the table of the fit."""

from dataclasses import replace

import numpy as np
import pytest
from instances import some

import gpmodel as gp
from gpmodel.table.dataset import Dataset

WEAK = ("joint_compliance J2=1e-6", "joint_compliance J3=2e-6")
WARM = (*WEAK, "thermal_zero J2=3e-5", "thermal growth of the link before J3.fixed (temperature)=5e-6")

FOUND = ("joint_compliance J2", "joint_compliance J3", "thermal_zero J2")


def carrying(data: Dataset, kilograms: float) -> Dataset:
    return replace(data, payload=np.full(len(data), kilograms), payload_given=True)


@pytest.mark.first(1)
@pytest.mark.parametrize("moved", [0.0, 4e-4])
@pytest.mark.parametrize("seed", some([1, 2, 3], 1))
def test_a_model_is_less_certain_at_temperatures_beyond_its_fit(seed: int, moved: float) -> None:
    """The growth of a link is too small to be found in the fit, and biases the drift of the zero."""
    column = {"temperature [degC]": "18:40"}
    made = gp.simulate("irb6400r", WARM, poses=190, seed=seed, noise="0.03 mm", inputs=column).table
    degrees = made.extras["temperature"]
    cold, hot = np.flatnonzero(degrees < 28.0), np.flatnonzero(degrees > 34.0)[:25]
    model = gp.calibrate("irb6400r", made.subset(cold), effects=FOUND, holdout=0.0).model
    record = gp.verify(model, replace(made.subset(hot), q=made.q[hot] - moved * np.eye(6)[2])).record
    assert [change.name for change in record.changes] == (["zero of J3"] if moved else [])
    if moved:
        assert record.changes[0].value == pytest.approx(moved, abs=3.5 * record.changes[0].stderr)


@pytest.mark.first(1)
@pytest.mark.parametrize("centre", ["0,0,250mm", "120,-80,60mm", "0,0,0mm"])
@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("kilograms", [10.0, 40.0])
def test_a_load_is_named_alone_and_only_if_it_is_not_declared(kilograms: float, declared: bool, centre: str) -> None:
    """The arm carries the load at a centre of mass that no description states."""
    arm = gp.load_mechanism("irb6400r", payload_com=centre)
    both = gp.simulate(arm, WEAK, poses=160, seed=4, noise="0.02 mm", inputs={"payload [kg]": f"0|{kilograms:g}"}).table
    loaded = np.flatnonzero(both.payload == kilograms)[-30:]
    empty = np.setdiff1d(np.flatnonzero(both.payload == 0.0), loaded)
    model = gp.calibrate("irb6400r", carrying(both.subset(empty), 0.0), effects=["joint_compliance"], holdout=0.0).model
    record = gp.verify(model, carrying(both.subset(loaded), kilograms if declared else 0.0)).record
    assert [change.name for change in record.changes] == ([] if declared else ["mass at the tool"])
    if not declared:
        assert record.changes[0].value == pytest.approx(kilograms, abs=3.5 * record.changes[0].stderr)
