"""Test reports from fits, their quantities, and ISO 9283."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import measure, mechanism
from hypothesis import given
from hypothesis import strategies as st
from loop_cases import QUICK, found, quick, rms, robot
from report_runs import calibrated, discovered, evolved, quickly

from gpmodel.calibration.comparison import fit_steps, nested_models
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.families.candidate import BRED, Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect, effect_at
from gpmodel.model.error_model import prepare
from gpmodel.model.sites import geometric_effects, table_names, translate
from gpmodel.report.effects import quantity, read_columns, shape
from gpmodel.report.from_discovery import _causes, from_discovery
from gpmodel.report.origin import Origin, positioning, repeatability, versions
from gpmodel.report.saved import to_json
from gpmodel.report.schema import Report
from gpmodel.report.verdict import of_discovery
from gpmodel.selection.causes import Cause, CredibleSet


def report(case: str) -> Report:
    return discovered(case)


def built(discovery: Discovery) -> Report:
    return from_discovery(discovery, Origin("gpmodel discover", 0))


@pytest.mark.long
def test_figures_are_those_of_the_steps_in_millimetres() -> None:
    for step, rung in zip(found("gear", 0).steps, report("gear").ladder, strict=True):
        assert rung.heldout.rms_mm == pytest.approx(1e3 * rms(step.heldout_error))
        assert rung.train.max_mm == pytest.approx(1e3 * step.train_error.max())
        assert rung.dropped == step.calibration.dropped


def test_an_effect_carries_its_size_its_deviation_and_its_name() -> None:
    (effect,) = report("gear").effects
    truth = robot("gear", 0)[0].theta[-2:]
    assert effect.name == "gear error, 2 per turn, J4"
    assert (effect.slot, effect.axis, effect.inputs) == ("J4.moving", "Rx", ("J4",))
    assert (effect.unit, effect.catalogue) == ("rad", "gear_harmonic")
    assert abs(effect.value - np.hypot(*truth)) < 3.5 * effect.stderr
    assert effect.stderr < 0.2 * effect.value
    assert 0 < effect.unique_share <= 1
    assert report("gear").ladder[2].effect == 0


def test_the_verdict_on_many_findings_says_their_number() -> None:
    (effect,) = report("gear").effects
    at = {j: replace(effect, name=f"gear error, 2 per turn, {j}", slot=f"{j}.moving") for j in ("J4", "J1")}
    base, coupling = replace(effect, name="base compliance", slot="base"), replace(effect, name="coupling, J4 to J5")
    said = of_discovery(replace(report("gear"), effects=(at["J4"], base, at["J1"], coupling)))
    assert said.startswith("Four effects were missing and are confirmed: ")


@pytest.mark.long
def test_a_finding_that_matches_no_family_says_so() -> None:
    first = report("windup").effects[0]
    assert first.catalogue is None
    assert first.explanation == "matches no named effect"
    assert first.found_by in ("formula", "formula of a program", *BRED, "sequence")
    others = [one for one in first.front if not one.taken]
    assert len(others) == len(first.front) - 1
    assert [one.nats for one in others] == sorted(one.nats for one in others)
    assert [one.nodes for one in first.front] == sorted(one.nodes for one in first.front)


def test_the_verdict_says_what_was_added_or_that_nothing_was() -> None:
    assert report("nothing").verdict.startswith("Nothing was added: no further effect is significant at these poses, ")
    assert report("nothing").effects == ()
    standard, after = (report("gear").ladder[k].heldout.rms_mm for k in (1, -1))
    said = report("gear").verdict
    assert (
        said
        == f"One effect was missing and is confirmed: standard model {standard:.3f} → {after:.3f} mm on held-out poses."
    )


@pytest.mark.long
def test_the_same_run_gives_the_same_report() -> None:
    one, other = (built(quick()) for _ in range(2))
    assert to_json(one) == to_json(other)


@pytest.mark.long
def test_the_number_of_workers_is_not_in_the_report() -> None:
    two = found("gear", 0, replace(QUICK, workers=2))
    texts = [to_json(built(d)) for d in (quick(), two)]
    assert texts[0] == texts[1]


@pytest.mark.long
def test_outliers_are_rows_of_the_file_and_names_are_the_tables() -> None:
    truth, train, heldout = robot("nothing", 0)
    position = truth.poses.dataset.position.copy()
    position[5] += 3e-3
    columns = tuple(f"axis_{i}" for i in range(1, 7))
    data = replace(truth.poses.dataset, position=position, row=truth.poses.dataset.row + 100, columns=columns)
    answer = discover(
        truth.model.mechanism, prepare(truth.model.mechanism, data), train, heldout, search=Search(max_effects=0)
    )
    made = built(answer)
    assert made.data.outliers == (106,)
    assert made.mechanism.joints == columns
    assert {p.name.split()[0] for p in made.parameters} == set(columns)


def test_the_noise_floor_is_of_repeats_before_the_instruments_figure_which_is_of_one_coordinate() -> None:
    assert (report("nothing").noise_floor_mm, report("nothing").noise_from) == (None, None)
    assert quickly().noise_floor_mm == pytest.approx(0.03 * np.sqrt(3))
    assert quickly().noise_from == "instrument"


def test_repeatability_is_that_of_a_known_spread() -> None:
    data = quick().poses.dataset
    rng = np.random.default_rng(0)
    spread = 2e-5 * rng.normal(size=(len(data), 3))
    labels = {"repeat": np.array([f"p{i % 8}" for i in range(len(data))])}
    found = repeatability(replace(data, position=spread, labels=labels))
    assert found is not None
    assert (found.poses, found.measurements) == (8, len(data))
    assert found.rms_mm == pytest.approx(0.02 * np.sqrt(3), rel=0.2)
    assert found.rms_mm < found.rp_mean_mm < found.rp_max_mm < 0.12
    assert repeatability(data) is None


def test_dropped_parameters_have_no_deviation() -> None:
    for parameter in report("nothing").parameters:
        assert parameter.kept == (parameter.stderr is not None)
        assert parameter.kept or parameter.value == 0.0


def test_versions_name_what_the_numbers_depend_on() -> None:
    assert {"python", "gpmodel", "numpy", "scipy"} <= set(versions())


def test_the_shape_of_a_finding_follows_its_data() -> None:
    (shape,) = report("gear").plots.shapes
    assert (shape.x_name, shape.x_unit, shape.y_unit) == ("J4", "deg", "µrad")
    curve = np.interp(shape.x, shape.curve_x, shape.curve_y)
    assert np.corrcoef(curve, shape.partial)[0, 1] > 0.9


def test_what_an_effect_moves_at_the_tool_is_what_was_planted() -> None:
    (effect,) = report("gear").effects
    assert effect.tool_rms_mm == pytest.approx(0.2, rel=0.1)
    assert effect.tool_max_mm > effect.tool_rms_mm
    assert effect.tool_turn_mrad == pytest.approx(1e3 * effect.value / np.sqrt(2.0), rel=0.1)
    (trained,) = effect.ranges
    assert (trained.input, trained.unit) == ("J4", "deg")
    assert -360 < trained.low < trained.high < 360


def test_held_out_poses_confirm_what_was_planted() -> None:
    confirmation = report("gear").confirmation
    assert confirmation is not None
    assert confirmation.passed
    assert confirmation.p_value < confirmation.limit
    assert confirmation.units == 20
    assert report("nothing").confirmation is None


@pytest.mark.long
def test_residuals_pose_by_pose_are_those_of_the_ladder() -> None:
    for made in (report("gear"), calibrated()):
        held = np.array(made.plots.heldout_mask)
        for name, step in (("registration", made.ladder[0]), ("standard", made.ladder[1]), ("final", made.ladder[-1])):
            length = np.linalg.norm(np.array(made.plots.residual_mm[name], dtype=float), axis=1)
            assert rms(length[held]) == pytest.approx(step.heldout.rms_mm, rel=1e-4)
            assert rms(length[~held]) == pytest.approx(step.train.rms_mm, rel=1e-4)


def test_the_arm_is_drawn_from_base_to_nominal_tip() -> None:
    plots = report("gear").plots
    tips = np.array(plots.points_mm)[list(plots.chain_poses)]
    np.testing.assert_allclose(np.array(plots.chain_mm)[:, -1], tips, atol=0.02)
    assert len(plots.slots) == len(plots.chain_mm[0])


def test_a_calibration_reports_the_effect_that_was_named() -> None:
    made = calibrated()
    (effect,) = made.effects
    assert effect.name not in {p.name for p in made.parameters}
    assert effect.value == pytest.approx(3e-7, abs=4 * effect.stderr)
    assert effect.found_by == "named"
    assert [rung.step for rung in made.ladder] == ["registration", "standard", "base_compliance"]


def test_an_evolution_reports_its_runs_and_what_they_refer_to() -> None:
    made = evolved()
    assert [(r.number, r.shuffled) for r in made.runs] == [(0, False), (0, True), (1, False), (1, True)]
    (histogram,) = made.histograms
    assert (histogram.runs, histogram.shuffled_runs) == ({"linear": 2}, {"linear": 2})
    assert set(histogram.counts) == {"linear"}
    assert sum(histogram.referring) == sum(histogram.counts["linear"]) > 0


NOISE, TIMES = 2e-5, 4


def test_pose_accuracy_is_as_good_of_poses_held_out_as_of_poses_fitted() -> None:
    """Each mean of four readings is off by its noise and by what the fit does not know."""
    plain = measure("ur5", (), (), 1, count=80, noise=0.0)
    again = plain.poses.dataset.subset(np.repeat(np.arange(80), TIMES))
    rng = np.random.default_rng(0)
    data = replace(
        again, position=again.position + NOISE * rng.normal(size=again.position.shape), row=np.arange(80 * TIMES),
        labels={"repeat": np.array([f"p{k // TIMES}" for k in range(80 * TIMES)])},
    )  # fmt: skip
    poses = prepare(plain.model.mechanism, data)
    train = np.arange(50 * TIMES)
    models = nested_models(geometric_effects(plain.model.mechanism), ())
    steps = fit_steps(
        plain.model.mechanism, models, poses.subset(train), poses.subset(np.arange(50 * TIMES, 80 * TIMES))
    )
    held = positioning(poses, train, steps)
    fitted = positioning(poses.subset(train), train, steps)
    assert held is not None
    assert fitted is not None
    assert (held.poses, held.heldout, fitted.poses, fitted.heldout) == (30, True, 50, False)
    assert fitted.after_mm == pytest.approx(
        held.after_mm, abs=3 * np.hypot(held.after_stderr_mm, fitted.after_stderr_mm)
    )
    assert 0.7 < held.after_mm / (1e3 * NOISE * np.sqrt(8 / np.pi / TIMES)) < 1.7
    assert held.before_mm > 10 * held.after_mm
    assert held.after_max_mm > held.after_mm


def test_it_is_not_stated_where_nothing_was_measured_three_times() -> None:
    truth = measure("ur5", (), (), 1, count=60)
    steps = fit_steps(truth.model.mechanism, nested_models((), ()), truth.poses, truth.poses)
    assert positioning(truth.poses, np.arange(60), steps) is None


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


@pytest.mark.parametrize(
    ("own", "groups", "said"),
    [
        (True, ("after row 60 within 0.19 rows",), ("the name of the final fit",)),
        (True, ("after row 60 within 0.19 rows", "a rival"), ("the name of the final fit", "a rival")),
        (False, ("a rival", "another"), ("a rival", "another")),
    ],
)
def test_a_finding_has_one_name_among_its_causes(own: bool, groups: tuple[str, ...], said: tuple[str, ...]) -> None:
    """The constants in a name are fitted three times: the cause that is the finding has the name of the last fit."""
    hypothesis = quick().findings[0].hypothesis
    assert hypothesis.causes is not None
    (first, *_) = hypothesis.causes.causes[0].groups
    cause = Cause(tuple(replace(first, name=name) for name in groups), 1.0, own)
    (record,) = _causes(replace(hypothesis, causes=CredibleSet((cause,), 0.0)), "the name of the final fit", {})
    assert record.names == said
