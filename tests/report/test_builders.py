"""Builders of reports: the numbers are those of the run, in millimetres, under the table's own names."""

from dataclasses import replace

import numpy as np
import pytest
from loop_cases import QUICK, found, quick, rms, robot
from report_runs import calibrated, discovered, evolved, quickly

from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.families.candidate import BRED
from gpmodel.model.error_model import prepare
from gpmodel.report.from_discovery import from_discovery
from gpmodel.report.iso9283 import repeatability
from gpmodel.report.origin import Origin, floor_mm, versions
from gpmodel.report.saved import to_json
from gpmodel.report.schema import Report
from gpmodel.report.verdict import of_discovery


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
    assert report("nothing").verdict.startswith("Nothing was added: these poses show no missing effect, ")
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
    data = quick().poses.dataset
    twice = np.array([f"p{i // 2}" for i in range(len(data))])
    repeated = replace(data, labels={"repeat": twice})
    floor, source = floor_mm(repeated, 5e-5)
    assert source == "repeats"
    assert floor is not None
    assert floor > 1.0


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
