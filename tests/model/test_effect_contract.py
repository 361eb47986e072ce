"""Test that the column of every candidate is the derivative of the prediction, for all mechanisms."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from effect_cases import MECHANISMS, Truth, bare, measure, mechanism, random_placement
from residual_cases import best_nats
from scipy.linalg import expm

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Weighting, effect_columns, linearise
from gpmodel.calibration.result import errors_on
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import scores
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect, Term, axis_unit, drive_effect, effect_at
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States
from gpmodel.numerics import se3
from gpmodel.report.effects import quantity, shape
from gpmodel.report.fitted import statistics_mm
from gpmodel.report.schema import ErrorsMm

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
    problem = linearise(model, poses, at, placement, Weighting({"rotation": 0.3}, use))
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
def test_the_complete_set_is_six_a_link_that_moves(name: str) -> None:
    effects, links = geometric_effects(mechanism(name)), [s for s in mechanism(name).slots if s.endswith(".moving")]
    assert len(effects) == len({e.name for e in effects}) == 6 * len(links)
    assert all(e.constant and e.unit == axis_unit(e.terms[0].axis) for e in effects)


def test_an_unknown_axis_is_refused() -> None:
    with pytest.raises(InputError, match="axis 'rx' is unknown; available: Tx, Ty"):
        Term("base", "rx")


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
        *anchor, zero = truth.placement.anchors[name]
        np.testing.assert_allclose(np.linalg.norm(points - anchor, axis=1) + zero, values, atol=1e-12)


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


@dataclass(frozen=True)
class Bump:
    """A notch in a track: exp(-(s - centre)² / 2 width²) of one column."""

    column: str
    centre: float
    width: float

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.column,)

    def __call__(self, states: States) -> Array:
        return np.exp(-0.5 * ((states[self.column] - self.centre) / self.width) ** 2)

    def __str__(self) -> str:
        return f"notch({self.column})"


NOTCH = Effect(
    "notched track",
    (Term("J3.moving", "Ry", Bump("J2", 0.3, 0.4)), Term("base", "Tz", Bump("J1", 0.0, 1.0), 0.2)),
    "rad",
)


def test_a_new_basis_is_predicted_fitted_judged_and_reported() -> None:
    truth = measure("irb6400r", (NOTCH,), (2e-3,), 21, dataset=bare("irb6400r", 90, 21, payload=False))
    train, rest = truth.poses.subset(np.arange(70)), truth.poses.subset(np.arange(70, 90))
    standard = geometric_effects(mechanism("irb6400r"))
    without = calibrate(ErrorModel(mechanism("irb6400r"), standard), train)
    candidate = Candidate("notched track", (NOTCH,), "", 4.0)
    residual = residual_of(without, train, Criteria(), 0)
    (score,) = scores(residual, [candidate])
    null = best_nats(residual, [candidate], residual.permuted(np.random.default_rng(0), 40))
    assert score.nats > null.max() + 20
    fit = calibrate(ErrorModel(mechanism("irb6400r"), (*standard, NOTCH)), train)
    found = quantity(fit, candidate, train.states)
    assert abs(found.value - 2e-3) < 3 * found.stderr
    assert (found.basis, found.unit) == ("notch(J2)", "rad")
    np.testing.assert_allclose(shape(fit, candidate, train.states), found.value * Bump("J2", 0.3, 0.4)(train.states))
    assert np.sqrt(np.mean(errors_on(fit, rest) ** 2)) < 0.7 * np.sqrt(np.mean(errors_on(without, rest) ** 2))
    assert NOTCH.inputs == ("J2", "J1")


def test_its_columns_are_the_derivative_of_the_prediction() -> None:
    truth = measure("irb6400r", (NOTCH,), (0.0,), 22, count=9, geometry=0.0)
    ahead, behind = (observe(truth.model, truth.poses, np.array([d]), truth.placement) for d in (1e-5, -1e-5))
    seen = observe(truth.model, truth.poses, truth.theta, truth.placement)
    columns = effect_columns((NOTCH,), truth.model, truth.poses, seen)[:, :3, 0]
    np.testing.assert_allclose(columns, (ahead.tip - behind.tip)[:, :3, 3] / 2e-5, atol=1e-8)


def test_a_known_physical_effect_is_one_line() -> None:
    effect = effect_at("kinked cable", "J5.moving", "Rx", Bump("J6", 1.0, 0.3))
    assert not effect.constant
    assert effect.twist(measure("irb6400r", (), (), 1, count=4).poses.states, "J5.moving").shape == (4, 6)
