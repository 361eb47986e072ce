"""Compliance under a load that is not the declared one: the torque of a kilogram, and a payload declared wrongly."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, mechanism

import gpmodel as gp
from gpmodel.families.candidate import Candidate
from gpmodel.families.load import other_loads
from gpmodel.model.error_model import prepare
from gpmodel.table.dataset import Dataset

ARMS = ("irb6400r", "ur5", "panda")


def carrying(data: Dataset, kilograms: float) -> Dataset:
    return replace(data, payload=np.full(len(data), kilograms), payload_given=True)


def offered(name: str, payload: float = 2.0) -> tuple[list[Candidate], Dataset]:
    data = carrying(bare(name, 40, 3), payload)
    return list(other_loads(mechanism(name), prepare(mechanism(name), data).states)), data


@pytest.mark.parametrize("name", ARMS)
def test_a_kilogram_more_is_the_torque_of_a_kilogram_more(name: str) -> None:
    every, data = offered(name)
    heavy = prepare(mechanism(name), carrying(data, 3.0)).states
    light = prepare(mechanism(name), data).states
    made = next(c for c in every if "kg more at the tool" in c.name and c.inner)
    assert made.inner is not None
    for effect in made.inner.at([1.0]).effects:
        joint = effect.name.rsplit(": ", 1)[1]
        basis = effect.terms[0].basis(light)
        size = float(np.max(np.abs(heavy[f"torque_{joint}"])))
        np.testing.assert_allclose(basis, heavy[f"torque_{joint}"], atol=1e-4 * size)


@pytest.mark.parametrize("name", ARMS)
def test_the_constant_is_shared_and_every_load_is_offered_in_both_directions(name: str) -> None:
    every, _ = offered(name)
    for made in every:
        assert made.inner is not None
        assert len(made.inner.constants) == 1
        assert len(made.effects) == 2
        assert made.name.count("compliance") == 1
    for side in (-1.0, 1.0):
        found = [c.inner.name for c in every if c.inner and c.inner.values[0] * side > 0.0]
        assert set(found) == {c.inner.name for c in every if c.inner}


def test_an_arm_of_sliding_joints_or_without_masses_has_no_other_loads() -> None:
    weightless = replace(mechanism("ur5"), links=tuple(replace(link, mass=0.0) for link in mechanism("ur5").links))
    states = prepare(weightless, bare("ur5", 40, 3, payload=False)).states
    assert list(other_loads(weightless, states)) == []


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


@pytest.mark.long
@pytest.mark.parametrize(("declared", "named"), [(100.0, True), (180.0, False)])
def test_a_payload_that_is_declared_wrongly_is_named_with_its_mass(declared: float, named: bool) -> None:
    """Joints 2 and 3 yield to the true payload, 180 kg."""
    arm = gp.load_mechanism("irb6400r")
    weak = ["joint_compliance J2=1e-6", "joint_compliance J3=2e-6"]
    table = gp.simulate(arm, weak, poses=140, seed=4, noise="0.02 mm", inputs={"payload [kg]": "180|180"}).table
    found = gp.discover(arm, carrying(table, declared), search=gp.Search(runs=0, workers=1))
    names = [f.name for f in found.findings]
    if named:
        (load,) = (f for f in found.findings if "kg more at the tool" in f.name)
        (constant,) = load.constants
        assert constant.value == pytest.approx(180.0 - declared, abs=3 * constant.stderr)
        assert constant.stderr < 20.0
    else:
        assert sorted(names) == ["joint compliance, J2", "joint compliance, J3"]
