"""The prediction against the product of matrices it stands for, and what it counts as an error."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import MECHANISMS, Truth, bare, measure, mechanism, random_placement
from scipy.linalg import expm

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect, Term, effect_at
from gpmodel.model.error_model import ErrorModel, measured_minus, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.report.fitted import statistics_mm
from gpmodel.report.schema import ErrorsMm


def written_out(truth: Truth) -> Array:
    """T_register T_0 E_0 T_1 E_1 ... T_tool, pose by pose, with the general matrix exponential."""
    poses, data = truth.poses, truth.poses.dataset
    slots = truth.model.mechanism.slots
    out = []
    for n in range(len(poses)):
        frame = truth.placement.registration[str(data.label("setup")[n])]
        for s, slot in enumerate(slots):
            twist = sum(
                v * e.twist(poses.states, slot)[n] for e, v in zip(truth.model.effects, truth.theta, strict=True)
            )
            generator = np.zeros((4, 4))
            generator[:3, :3], generator[:3, 3] = se3.hat(np.asarray(twist)[3:]), np.asarray(twist)[:3]
            frame = frame @ poses.transforms[s, n] @ expm(generator)
        out.append(frame @ truth.placement.tool[str(data.label("tool")[n])])
    return np.array(out)


@pytest.mark.parametrize("name", MECHANISMS)
def test_prediction_is_the_product_of_its_frames(name: str) -> None:
    effects = (
        effect_at("a", "base", "Rx", Expression("sin(x)")),
        Effect("b", tuple(Term(s, a, Expression("y")) for s, a in zip(mechanism(name).slots, AXES, strict=False)), "m"),
    )
    truth = measure(name, effects, (2e-3, -1e-3), 1, count=6, setups=2, tools=2)
    seen = observe(truth.model, truth.poses, truth.theta, truth.placement)
    np.testing.assert_allclose(seen.tip, written_out(truth), atol=1e-12)


@pytest.mark.parametrize("name", MECHANISMS)
def test_no_effect_switched_on_is_ignored(name: str) -> None:
    """Every parameter of the complete set, and each of them together with the rest, changes the predicted pose."""
    data = bare(name, 8)
    poses = prepare(mechanism(name), data)
    placement = random_placement(data, np.random.default_rng(1))
    model = ErrorModel(mechanism(name), geometric_effects(mechanism(name)))
    at = 1e-3 * np.random.default_rng(2).normal(size=len(model.effects))
    before = observe(model, poses, at, placement).tip
    for k in range(len(at)):
        after = observe(model, poses, at + 1e-3 * np.eye(len(at))[k], placement).tip
        assert np.abs(after - before).max() > 1e-4, model.effects[k].name


def test_two_effects_at_one_slot_act_together() -> None:
    data = bare("ur5", 5)
    poses = prepare(mechanism("ur5"), data)
    placement = random_placement(data, np.random.default_rng(1))
    slot = mechanism("ur5").slots[4]
    one = effect_at("one", slot, "Tx", Expression("x"))
    same = effect_at("same", slot, "Tx", Expression("x"))
    both = observe(ErrorModel(mechanism("ur5"), (one, same)), poses, np.array([1e-3, 2e-3]), placement).tip
    single = observe(ErrorModel(mechanism("ur5"), (one,)), poses, np.array([3e-3]), placement).tip
    np.testing.assert_allclose(both, single, atol=1e-15)


def test_an_effect_at_a_slot_the_mechanism_has_not_is_never_skipped() -> None:
    with pytest.raises(
        InputError, match=r"effect 'lost': slot 'J77.moving' is unknown; available: elbow_joint.moving, "
    ):
        ErrorModel(mechanism("ur5"), (effect_at("lost", "J77.moving", "Rx"),))


def test_as_many_values_as_effects_are_expected() -> None:
    data = bare("ur5", 5)
    model = ErrorModel(mechanism("ur5"), geometric_effects(mechanism("ur5")))
    with pytest.raises(ValueError, match="zip"):
        observe(model, prepare(mechanism("ur5"), data), np.zeros(3), random_placement(data, np.random.default_rng(0)))


def test_distances_are_from_the_anchor_in_the_root_to_the_point() -> None:
    truth = measure("ur5", (), (), 2, count=7, noise=0.0, see=("position", "distance"))
    back = np.linalg.inv(truth.placement.registration[""])
    points = truth.poses.dataset.position @ back[:3, :3].T + back[:3, 3]
    for name, values in truth.poses.dataset.distances.items():
        np.testing.assert_allclose(np.linalg.norm(points - truth.placement.anchors[name], axis=1), values, atol=1e-12)


def test_a_rotation_error_is_one_rotation_vector_and_no_difference_of_angles() -> None:
    """Near half a turn, where differences of rotation vectors or of roll, pitch and yaw jump."""
    truth = measure("ur5", (), (), 3, count=40, noise=0.0, see=("position", "rotation"))
    extra = se3.exp(np.array([0, 0, 0, 1e-3, -2e-3, 0.5e-3]))[:3, :3]
    turned = se3.rotation_vector(
        extra @ se3.exp(np.hstack([np.zeros((40, 3)), truth.poses.dataset.rotation]))[:, :3, :3]
    )
    data = replace(truth.poses.dataset, rotation=turned)
    seen = observe(truth.model, truth.poses, truth.theta, truth.placement)
    residual = measured_minus(seen, data)[:, 3:6]
    np.testing.assert_allclose(residual, np.tile([1e-3, -2e-3, 0.5e-3], (40, 1)), atol=1e-9)
    assert np.linalg.norm(turned, axis=1).max() > 3.0


def test_what_was_not_measured_is_no_error_and_no_zero() -> None:
    truth = measure("ur5", (), (), 3, count=6, noise=0.0, see=("position", "rotation", "distance"))
    holes = truth.poses.dataset.position.copy()
    holes[2, 1] = np.nan
    data = replace(truth.poses.dataset, position=holes, rotation=np.full((6, 3), np.nan))
    residual = measured_minus(observe(truth.model, truth.poses, truth.theta, truth.placement), data)
    assert np.isnan(residual[2, 1])
    assert np.isnan(residual[:, 3:6]).all()
    assert np.isfinite(np.delete(residual[:, :3].ravel(), 7)).all()
    np.testing.assert_allclose(residual[:, 6:], 0.0, atol=1e-12)


def test_rms_is_of_the_three_dimensional_distance() -> None:
    error = np.linalg.norm(np.array([[3e-3, 4e-3, 0.0], [0.0, 0.0, 12e-3]]), axis=1)
    found = statistics_mm(error)
    assert found == ErrorsMm(8.5, pytest.approx(np.sqrt((25 + 144) / 2)), pytest.approx(12.0))
    assert statistics_mm(error[:0]) == ErrorsMm(None, None, None)


def test_a_subset_predicts_what_the_whole_does() -> None:
    truth = measure("irb6400r", (), (), 5, count=9)
    rows = np.array([8, 1, 4])
    whole = observe(truth.model, truth.poses, truth.theta, truth.placement).tip
    np.testing.assert_array_equal(
        observe(truth.model, truth.poses.subset(rows), truth.theta, truth.placement).tip, whole[rows]
    )
