"""A finding in an engineer's terms."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import measure, mechanism
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect, effect_at
from gpmodel.model.naming import table_names, translate
from gpmodel.report.quantity import quantity, read_columns, shape

JOINT = mechanism("ur5").joints[3]
J = JOINT.name
PAIR = tuple(drive_effect(f"gear, {f}", JOINT, Expression(f"{f}(2*{J})")) for f in ("sin", "cos"))
CURVE = tuple(
    drive_effect(f"curve, {f} {n}", JOINT, Expression(f"{f}({n}*{J})")) for n in (1, 2, 3, 4) for f in ("sin", "cos")
)


def test_one_unknown_is_its_value_and_deviation() -> None:
    effect = drive_effect("ratio", JOINT, Expression(J), "1")
    truth = measure("ur5", (effect,), (1e-4,), 1, geometry=0.0)
    fit = calibrate(truth.model, truth.poses)
    found = quantity(fit, Candidate("ratio", (effect,), "gear_ratio", 4.0), truth.poses.states)
    assert (found.value, found.stderr, found.basis, found.unit) == (fit.theta[0], fit.stderr[0], J, "1")


@pytest.mark.parametrize("phase", [-2.5, -0.4, 0.0, 1.2, 3.0])
def test_a_pair_is_an_amplitude_and_a_phase(phase: float) -> None:
    truth = measure("ur5", PAIR, 3e-4 * np.array([np.cos(phase), np.sin(phase)]), 2, geometry=0.0)
    fit = calibrate(truth.model, truth.poses)
    candidate = Candidate("gear", PAIR, "gear_harmonic", 4.0)
    found = quantity(fit, candidate, truth.poses.states)
    assert abs(found.value - 3e-4) < 3 * found.stderr
    written = found.value * Expression(found.basis)(truth.poses.states)
    np.testing.assert_allclose(written, shape(fit, candidate, truth.poses.states), atol=1e-3 * found.value)


@pytest.mark.long
def test_the_deviation_of_an_amplitude_is_that_of_repeated_fits() -> None:
    candidate = Candidate("gear", PAIR, "gear_harmonic", 4.0)
    found = []
    for seed in range(40):
        truth = measure("ur5", PAIR, (2e-4, 2e-4), seed, count=30, geometry=0.0)
        found.append(quantity(calibrate(truth.model, truth.poses), candidate, truth.poses.states))
    scores = [(q.value - np.hypot(2e-4, 2e-4)) / q.stderr for q in found]
    assert np.std(scores) == pytest.approx(1.0, abs=0.3)


def test_a_larger_set_is_the_rms_of_its_sum() -> None:
    theta = 1e-4 * np.random.default_rng(0).normal(size=8)
    truth = measure("ur5", CURVE, theta, 3, geometry=0.0)
    fit = calibrate(truth.model, truth.poses)
    candidate = Candidate("curve", CURVE, "joint_curve", 4.0)
    found = quantity(fit, candidate, truth.poses.states)
    assert found.value == pytest.approx(np.sqrt(np.mean(shape(fit, candidate, truth.poses.states) ** 2)))
    true = np.sqrt(np.mean((theta @ [e.terms[0].basis(truth.poses.states) for e in CURVE]) ** 2))
    assert abs(found.value - true) < 4 * found.stderr
    assert found.basis == f"curve of {J}, 4 harmonics"
    few = quantity(fit, Candidate("curve", CURVE[:4], "joint_curve", 4.0), truth.poses.states).basis
    assert " - " in few
    assert "+ -" not in few


def test_one_basis_along_several_axes_is_the_length_of_its_vector() -> None:
    step = Expression("step(row - 20.5)")
    effects = tuple(effect_at(f"moved, {a}", "base", a, step) for a in ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz"))
    theta = np.array([3e-4, -4e-4, 0.0, 2e-4, 0.0, -1e-4])
    truth = measure("ur5", effects, theta, 4, count=60, geometry=0.0)
    fit = calibrate(truth.model, truth.poses)
    candidate = Candidate("moved", effects, "set_up_step", 4.0)
    found = quantity(fit, candidate, truth.poses.states)
    assert (found.basis, found.unit) == ("step(row - 20.5)", "m")
    assert abs(found.value - 5e-4) < 3 * found.stderr < 1e-4
    after = truth.poses.states["row"] > 20.5
    np.testing.assert_allclose(shape(fit, candidate, truth.poses.states), found.value * after)


NAMES = table_names(("J1", "J10", "elbow"), ("axis_1", "axis_10", "J3"))


@pytest.mark.parametrize(
    ("text", "translated"),
    [
        ("sin(2*J10)", "sin(2*axis_10)"),
        ("J1 + J10 + J100", "axis_1 + axis_10 + J100"),
        ("coupling, J1 to elbow", "coupling, axis_1 to J3"),
        ("torque_J1*torque_J10", "torque_axis_1*torque_axis_10"),
        ("moment_elbow_x and moment_base_x", "moment_J3_x and moment_base_x"),
        ("J10.moving", "axis_10.moving"),
        ("payload_torque_elbow", "payload_torque_J3"),
        ("last_move_elbow*stop_torque_J10_0p4", "last_move_J3*stop_torque_axis_10_0p4"),
        ("my_J1 J1_old", "my_J1 J1_old"),
    ],
)
def test_names_are_translated_whole(text: str, translated: str) -> None:
    assert translate(text, NAMES) == translated


@given(st.lists(st.sampled_from(["J1", "J10", "J11", "J101", "row", "x"]), min_size=1, max_size=8))
def test_j1_is_never_matched_inside_j10(words: list[str]) -> None:
    assert translate("*".join(words), {"J1": "first"}).split("*") == ["first" if w == "J1" else w for w in words]


def test_what_a_payload_alone_exerts_reads_as_payload_and_torque() -> None:
    assert read_columns(["payload_torque_J2", "J4", "payload"]) == ["payload", "torque_J2", "J4"]


def test_a_curve_that_is_no_wave_is_not_counted_in_harmonics() -> None:
    ramps = [f"tanh({k}*torque_{J}/100)" for k in (1, 3, 10)] + [f"max(torque_{J}/100 - 0.{k}, 0)" for k in range(1, 6)]
    effects = tuple(drive_effect(f"curve over the torque, {k}", JOINT, Expression(t)) for k, t in enumerate(ramps))
    truth = measure("ur5", effects[:1], (1e-4,), 1, geometry=0.0)
    fit = calibrate(replace(truth.model, effects=effects), truth.poses)
    found = quantity(fit, Candidate("curve", effects, "load_curve", 4.0), truth.poses.states)
    assert found.basis == f"curve of torque_{J}, a sum of 8 terms"
