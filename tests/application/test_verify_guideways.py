"""Test that `verify` names a sudden step of a guideway, with its place and its size."""

import re
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import Truth, bare, measure, mechanism
from verify_cases import NOISE

import gpmodel as gp
from gpmodel.application.verify import Verified, verified
from gpmodel.model.effect import Effect, effect_at
from gpmodel.model.error_model import ErrorModel, observe, prepare

STEP = re.compile(r"step of the guideway between (\S+) and (\S+) mm, ([XYZ])")
Gantry = tuple[gp.Model, Truth]


@pytest.fixture(scope="module")
def gantry() -> Gantry:
    truth = measure("gantry", (), (), 1, count=90, noise=NOISE)
    return gp.calibrate(mechanism("gantry"), truth.poses.dataset, holdout=0.0).model, truth


def later(gantry: Gantry, seed: int, effects: tuple[Effect, ...] = (), size: float = 0.0) -> Verified:
    """Verify the gantry at thirty new poses, with a change of a given size."""
    model, truth = gantry
    data = bare("gantry", 30, seed + 100, payload=False)
    machine = ErrorModel(truth.model.mechanism, (*truth.model.effects, *effects))
    theta = np.append(truth.theta, [size] * len(effects))
    points = observe(machine, prepare(machine.mechanism, data), theta, truth.placement).tip[:, :3, 3]
    noise = NOISE * np.random.default_rng([seed, 9]).normal(size=points.shape)
    return verified(model.saved, replace(data, position=points + noise))


@pytest.mark.first(2)
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("joint", "axis", "place", "size"), [("X", "Ty", 0.1, 2e-4), ("Y", "Tz", -0.1, 1e-4), ("X", "Rz", 0.0, 4e-4)]
)
def test_a_step_of_a_guideway_is_one_change_with_its_place(
    gantry: Gantry, seed: int, joint: str, axis: str, place: float, size: float
) -> None:
    """A gantry without rotations does not tell its tool point, so that a rotation is a step along all axes."""
    step = effect_at("step", f"{joint}.moving", axis, gp.Expression(f"step({joint} - {place})"))
    (change,) = later(gantry, seed, (step,), size).changes
    places = [found.groups() for name in (change.name, *change.rivals) if (found := STEP.match(name))]
    assert any(float(low) <= 1e3 * place <= float(high) and own == joint for low, high, own in places)
    assert change.name.endswith(f", {axis}" if axis[0] == "T" else f", {joint}")
    assert abs(change.value - size) < 4.0 * change.stderr or axis[0] == "R"


@pytest.mark.first(2)
@pytest.mark.parametrize("seed", range(6))
def test_a_gantry_without_a_change_holds(gantry: Gantry, seed: int) -> None:
    assert later(gantry, seed).verdict == "holds"
