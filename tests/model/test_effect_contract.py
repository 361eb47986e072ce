"""Every effect's column is the derivative of the prediction: all candidates of the catalogue, all mechanisms."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import MECHANISMS, bare, mechanism, random_placement

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns, linearise
from gpmodel.errors import InputError
from gpmodel.families import catalogue
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect, Term, axis_unit, drive_effect, effect_at
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3

ANCHORS = ("distance_a", "distance_b")


def scene(name: str, count: int = 11) -> tuple[Poses, Placement]:
    """Poses at which position, rotation and two distances are all observed, two setups and two tools."""
    data = bare(name, count, 3, setups=2, tools=2, in_order=True)
    placement = random_placement(data, np.random.default_rng(4), ANCHORS)
    empty = ErrorModel(mechanism(name), ())
    seen = observe(empty, prepare(mechanism(name), data), np.zeros(0), placement).tip
    turned = se3.rotation_vector(seen[:, :3, :3])
    data = replace(data, position=seen[:, :3, 3], rotation=turned, distances={a: np.zeros(count) for a in ANCHORS})
    return prepare(mechanism(name), data), placement


def derivative(effects: Sequence[Effect], k: int, poses: Poses, placement: Placement, at: Array, name: str) -> Array:
    """Central difference (N, 8) of position, rotation and distances over the k-th unknown."""
    model = ErrorModel(mechanism(name), tuple(effects))
    largest = max(float(np.abs(effects[k].twist(poses.states, s)).max(initial=0.0)) for s in effects[k].slots)
    step = 1e-5 / max(largest, 1e-12)
    ahead, behind = (observe(model, poses, at + side * step * np.eye(len(at))[k], placement) for side in (1, -1))
    data = replace(poses.dataset, position=ahead.tip[:, :3, 3])
    turns = measured_minus_rotation(ahead.tip, behind.tip)
    data = replace(data, distances=dict(zip(ANCHORS, ahead.distances.T, strict=True)))
    moved = measured_minus(behind, data)
    moved[:, 3:6] = turns
    return moved / (2 * step)


def measured_minus_rotation(first: Array, second: Array) -> Array:
    """Small rotation vectors (N, 3) of first after second, from the skew part."""
    skew = first[:, :3, :3] @ np.swapaxes(second[:, :3, :3], 1, 2)
    odd = 0.5 * (skew - np.swapaxes(skew, 1, 2))
    return np.column_stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]])


def pool(name: str) -> tuple[Effect, ...]:
    poses, _ = scene(name)
    arm = mechanism(name)
    evolved = tuple(
        effect_at(f"{slot} {axis}", slot, axis, Expression("tanh(3*x)*row")) for slot in arm.slots for axis in AXES
    )
    several = Effect(
        "several", (Term("base", "Rx", Expression("y"), 2.0), Term("tool", "Tz", Expression("z"), -0.5)), "1"
    )
    known = tuple(e for c in catalogue.candidates(arm, poses.states) for e in c.effects)
    return (*geometric_effects(arm), *evolved, several, *known)


@pytest.mark.long
@pytest.mark.parametrize("name", MECHANISMS)
def test_columns_are_the_derivatives_of_position_rotation_and_distance(name: str) -> None:
    poses, placement = scene(name)
    effects = pool(name)
    observed = observe(ErrorModel(mechanism(name), ()), poses, np.zeros(0), placement)
    columns = effect_columns(effects, ErrorModel(mechanism(name), ()), poses, observed)
    assert columns.shape == (len(poses), 8, len(effects))
    for k, effect in enumerate(effects):
        numeric = derivative([effect], 0, poses, placement, np.zeros(1), name)
        size = np.abs(columns[:, :, k]).max()
        np.testing.assert_allclose(columns[:, :, k], numeric, atol=2e-8 * size + 1e-12, rtol=0, err_msg=effect.name)


@pytest.mark.parametrize("name", MECHANISMS)
def test_rows_are_the_weighted_columns_of_what_was_measured(name: str) -> None:
    poses, placement = scene(name)
    measured = poses.dataset.row[:, None] % 3 > 0
    missing = replace(poses.dataset, rotation=np.where(measured, poses.dataset.rotation, np.nan))
    poses, effects = prepare(mechanism(name), missing), pool(name)
    model, use = ErrorModel(mechanism(name), effects), np.arange(len(poses)) != 4
    at = 1e-4 * np.random.default_rng(6).normal(size=len(effects))
    problem = linearise(model, poses, at, placement, 0.3, use)
    expected = problem.weigh(effect_columns(effects, model, poses, problem.observed))
    assert problem.columns.shape[0] == len(expected) < problem.weights.size
    rounding = 1e-11 * np.abs(expected).max(axis=0)
    assert (np.abs(problem.columns[:, problem.placement :] - expected) <= rounding).all()
    of_it = np.array([effect.of_the_instrument for effect in effects])
    placed = problem.columns[:, : problem.placement]
    rigid = placed[:, problem.rigid] @ np.linalg.lstsq(placed[:, problem.rigid], expected[:, of_it])[0]
    expected[:, of_it] -= rigid
    rounding[of_it] *= 1e3
    assert (np.abs(problem.effect_rows(effects, model) - expected) <= rounding).all()


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("size", [3e-4, 3e-3, 3e-2])
def test_columns_are_exact_beside_errors_of_any_size(name: str, size: float) -> None:
    """Every slot with a twist of that size (m and rad) on all its axes, constant and varying."""
    poses, placement = scene(name)
    arm = mechanism(name)
    constant = geometric_effects(arm)
    varying = tuple(drive_effect(f"late {j.name}", j, Expression("cos(3*x)")) for j in arm.joints)
    effects = (*constant, *varying)
    at = size * np.random.default_rng(5).choice([-1.0, 1.0], len(effects))
    model = ErrorModel(arm, effects)
    columns = effect_columns(effects, model, poses, observe(model, poses, at, placement))
    for k in (0, 4, 5, len(constant) - 3, len(constant), len(effects) - 1):
        numeric = derivative(effects, k, poses, placement, at, name)
        largest = np.abs(columns[:, :, k]).max()
        np.testing.assert_allclose(columns[:, :, k], numeric, atol=1e-7 * largest, rtol=0, err_msg=effects[k].name)


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_twist_is_the_weighted_basis_on_its_axis_and_nothing_elsewhere(name: str) -> None:
    poses, _ = scene(name)
    arm = mechanism(name)
    slot = arm.slots[2]
    effect = Effect("e", (Term(slot, "Ty", Expression("x"), 3.0), Term(slot, "Ty", Expression("1"), -1.0)), "m")
    twist = effect.twist(poses.states, slot)
    np.testing.assert_allclose(twist[:, 1], 3.0 * poses.states["x"] - 1.0)
    assert not np.delete(twist, 1, axis=1).any()
    assert not effect.twist(poses.states, "base").any()
    assert effect.inputs == ("x",)
    assert effect.slots == (slot,)


@pytest.mark.parametrize("name", MECHANISMS)
def test_an_error_of_a_joints_coordinate_is_the_motion_of_that_coordinate(name: str) -> None:
    """Side and sign: adding to the table's joint value moves the point as the drive effect says."""
    poses, placement = scene(name)
    arm = mechanism(name)
    for i, joint in enumerate(arm.joints):
        q = poses.dataset.q.copy()
        q[:, i] += 1e-3
        model = ErrorModel(arm, (drive_effect("zero", joint, Expression("1")),))
        by_effect = observe(model, poses, np.array([1e-3]), placement).tip
        by_joint = observe(ErrorModel(arm, ()), prepare(arm, replace(poses.dataset, q=q)), np.zeros(0), placement).tip
        np.testing.assert_allclose(by_effect, by_joint, atol=1e-12)


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_complete_set_is_six_a_joint(name: str) -> None:
    effects = geometric_effects(mechanism(name))
    assert len(effects) == len({e.name for e in effects}) == 6 * len(mechanism(name).joints)
    assert all(e.constant and e.unit == axis_unit(e.terms[0].axis) for e in effects)


def test_an_unknown_axis_is_refused() -> None:
    with pytest.raises(InputError, match="axis 'rx' is unknown; available: Tx, Ty"):
        Term("base", "rx")
