"""Test the Chapter 5 simulator that shares no code with the model, and the conclusions on its robots."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gpmodel as gp
from experiments.chapter5_outside import elastic_arm as arm
from experiments.chapter5_outside import extrapolation
from experiments.chapter5_outside import run as outside
from gpmodel.numerics.se3 import chain

FAST = replace(outside.SEARCH, max_effects=3)
"""Three findings are what the order of the springs is told from."""

SMALL = ["--population", "1024", "--generations", "20", "--slot_population", "128", "--slot_generations", "15"]
"""Programs enough to learn forty poses by heart."""

COMMITTED = Path(outside.__file__).parent / "results.json"


def robot(seed: int, planted: bool = True) -> arm.Robot:
    return arm.draw_robot(np.random.default_rng(seed), planted)


def potential(bent: arm.Robot, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Energy (N,) of weights and springs, J, from heights alone."""
    frames, _ = arm.placed(bent, q, u)
    centres = [frames[i + 1][:, :3, :3] @ (arm.PLACES[i + 1] / 2) + frames[i + 1][:, :3, 3] for i in range(6)]
    centres.append(frames[-1][:, :3, :3] @ arm.PAYLOAD_CENTRE + frames[-1][:, :3, 3])
    weights = [*arm.MASSES, arm.PAYLOAD]
    stiffness = 1 / np.array([bent.compliance[k] for k in ("base", "base", "J4", "J5")])
    height = sum(m * c[:, 2] for m, c in zip(weights, centres, strict=True))
    return -arm.GRAVITY[2] * height + 0.5 * u**2 @ stiffness


def test_every_spring_rests_where_the_energy_is_stationary() -> None:
    bent, q = robot(1), arm.draw_poses(np.random.default_rng(2), 20)
    rest = arm.equilibrium(bent, q)
    for k, size in enumerate(np.abs(rest).max(axis=0)):
        step = np.zeros(4)
        step[k] = 1e-5
        slope = (potential(bent, q, rest + step) - potential(bent, q, rest - step)) / 2e-5
        torque = size / [bent.compliance[n] for n in ("base", "base", "J4", "J5")][k]
        np.testing.assert_allclose(slope, 0.0, atol=2e-3 * torque)


def test_bending_is_of_higher_order_than_the_model_fits() -> None:
    """Torques at the bent arm differ from those of the straight one: what a model of first order cannot have."""
    bent, q = robot(1), arm.draw_poses(np.random.default_rng(2), 20)
    rest = arm.equilibrium(bent, q)
    soft = np.array([bent.compliance[k] for k in ("base", "base", "J4", "J5")])
    straight = soft * arm.gravity_torques(*arm.placed(bent, q, np.zeros((20, 4))))
    assert 1e-5 < np.abs(rest - straight).max() < 0.05 * np.abs(rest).max()


def test_without_errors_it_is_the_arm_that_the_product_knows() -> None:
    nominal = replace(robot(0, planted=False), errors=np.zeros((7, 6)))
    q = arm.draw_poses(np.random.default_rng(3), 20)
    frames, axes = arm.placed(nominal, q, np.zeros((20, 4)))
    known = gp.load_mechanism("irb6400r", arm.PAYLOAD, payload_com=tuple(arm.PAYLOAD_CENTRE))
    np.testing.assert_allclose(frames[-1], chain(known.transforms(q))[-1], atol=1e-12)
    theirs, ours = known.loads(q, np.full(20, arm.PAYLOAD)), arm.gravity_torques(frames, axes)
    for k, name in enumerate(("moment_base_x", "moment_base_y", "torque_J4", "torque_J5")):
        np.testing.assert_allclose(ours[:, k], theirs[name], atol=1e-3 * np.abs(ours).max())


def test_tables_repeat_and_differ() -> None:
    assert arm.table(0) == arm.table(0) != arm.table(1)
    assert arm.table(0) != arm.table(0, planted=False)


@pytest.mark.long
@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_base_then_j5_then_j4_are_named_and_beat_the_hand_made_model(seed: int) -> None:
    found = outside.one_robot(seed, True, FAST)
    assert [name for name in found["named"] if name in outside.SPRINGS] == ["base", "J5", "J4"]
    loop, hand = found["loop"][-1], found["hand_made"][-1]
    assert loop["mean_mm"] <= hand["mean_mm"]
    assert loop["max_mm"] <= hand["max_mm"]


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_a_rigid_robot_is_left_alone() -> None:
    found = outside.one_robot(0, False, FAST)
    assert found["named"] == []
    assert found["loop"][-1]["mean_mm"] < 3 * 1e3 * arm.NOISE


@pytest.mark.long
def test_a_program_of_the_tip_fails_on_poses_not_seen_and_programs_of_the_slots_do_not(tmp_path: Path) -> None:
    found = extrapolation.main([*SMALL, "--rounds", "2", "--seeds", "1", "--first", "2", "--out", str(tmp_path)])
    assert set(found["conclusions"].values()) == {"1 of 1"}
    assert (tmp_path / "extrapolation.json").exists()


@pytest.mark.slow
def test_extrapolation_fails_and_holds_on_robots_nobody_has_looked_at(tmp_path: Path) -> None:
    found = extrapolation.main(["--seeds", "4", "--first", "100", "--out", str(tmp_path)])
    for name, count in found["conclusions"].items():
        assert int(count.split(" of ")[0]) >= 3, name


@pytest.mark.slow
def test_the_conclusions_hold_on_robots_nobody_has_looked_at(tmp_path: Path) -> None:
    robots = [outside.one_robot(seed, True, outside.SEARCH) for seed in range(100, 106)]
    robots += [outside.one_robot(seed, False, outside.SEARCH) for seed in range(100, 103)]
    for name, count in outside.conclusions(robots).items():
        held, of = (int(word) for word in count.split(" of "))
        assert held >= of - 1, name
