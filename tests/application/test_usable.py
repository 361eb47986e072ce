"""Test the use of models: further poses, and predictions over causes."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import robot, table
from effect_cases import Truth, bare, measure, mechanism, sized
from model_cases import fitted

import gpmodel as gp
from experiments.spherical_joint.rigs import JOINT, rig_of
from gpmodel.api.model import POINTS, Point
from gpmodel.application.exports.rigid import note_of, refitted
from gpmodel.application.further import POSES, further_poses
from gpmodel.application.model_file import SavedModel, load_model, save_model, saved_model
from gpmodel.application.over_causes import CauseSet, causes_of, over_causes, with_cause_variance
from gpmodel.application.predict import coordinate_deviations, observed_by, placement_columns, predicted_columns
from gpmodel.application.usable import REACHES, at_end, usable
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.families import catalogue
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States, seen_columns
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.blocks import FOLD_SEED
from gpmodel.table.dataset import Dataset, unmeasured

LENGTHS = ["x [mm]", "y [mm]", "z [mm]"]


def model(seed: int, *effects: str | gp.Effect) -> gp.Model:
    return gp.calibrate(gp.load_mechanism("irb6400r"), table(50, seed=seed), effects).model


@pytest.mark.long
def test_the_deviation_covers_where_the_instrument_sees_the_true_point() -> None:
    """Over repetitions of one robot's measurement, misses over their stated deviations have a mean square of one."""
    mechanism, truth = robot(50, seed=2, noise=0.0)
    rng, found = np.random.default_rng(5), []
    clean = truth.dataset.position
    fresh = replace(truth.dataset, q=random_poses(mechanism, 50, rng), position=np.full_like(clean, np.nan))
    for _ in range(8):
        noisy = replace(truth.dataset, position=clean + rng.normal(0.0, 3e-5, clean.shape))
        fitted = gp.calibrate(mechanism, noisy, holdout=0.0, condition_limit=1e4).model
        found.append(fitted.predict(fresh))
    spread = np.std([frame[list(LENGTHS)].to_numpy() for frame in found], axis=0, ddof=1)
    stated = np.mean([frame["sigma [mm]"].to_numpy() for frame in found], axis=0)
    assert np.mean(np.linalg.norm(spread, axis=1) ** 2) == pytest.approx(np.mean(stated**2), rel=0.35)


def saved_law(text: str, family: str = "") -> tuple[SavedModel, tuple[float, float]]:
    """A model with a law of J3 at J3, and the range of J3 that it was fitted in."""
    law = Effect("law", (Term("J3.moving", "Ry", gp.Expression(text)),), "rad", family)
    measured = table(60, effects=("J3.moving:Ry:J3**3=1 mrad",))
    saved = gp.calibrate(gp.load_mechanism("irb6400r"), measured, [law], standard=("none",)).model.saved
    return saved, saved.ranges["J3"]


@pytest.mark.parametrize(("family", "clamped"), [("", True), ("drift", True), ("hardening_stiffness", False)])
def test_well_beyond_its_ranges_an_unnamed_law_and_a_creep_keep_their_value_and_others_go_on(
    family: str, clamped: bool
) -> None:
    saved, (low, high) = saved_law("J3**3", family)
    q = np.zeros((4, 6))
    q[:, 2] = high + (high - low) * REACHES[0] * np.array([0.0, 0.5, 2.0, 3.0])
    poses = unmeasured([j.name for j in saved.mechanism.joints], q)
    assert predicted_columns(usable(saved), poses)["outside"].tolist() == ["", "J3", "J3", "J3"]
    twist = usable(saved).model.effects[0].terms[0].basis(prepare(saved.mechanism, poses).states)
    assert twist[1] == pytest.approx(q[1, 2] ** 3)
    assert (twist[2] == twist[3]) == clamped


@pytest.mark.long
@pytest.mark.parametrize(
    "text",
    ["reciprocal({x})", "reciprocal(square({x}))", "log({x})", "exp(-400*({x}))"],
    ids=["pole", "even pole", "logarithm", "steep"],
)
def test_a_law_ends_at_its_range_where_it_changes_much_beyond_it(text: str) -> None:
    _, (low, high) = saved_law("J3")
    reach = REACHES[-1] * (high - low)
    saved, _ = saved_law(text.format(x=f"J3 - ({low - 0.2 * reach})"))
    basis = usable(saved).model.effects[0].terms[0].basis
    at_edge, beyond = basis(States({"J3": np.array([low, low - 0.5 * reach])}, {"J3": "rad"}))
    assert at_edge == beyond


@pytest.mark.long
def test_a_law_goes_on_as_far_as_it_changes_little() -> None:
    _, (low, high) = saved_law("J3")
    width = high - low
    saved, _ = saved_law(f"reciprocal(J3 - ({low - 0.2 * width}))")
    basis = usable(saved).model.effects[0].terms[0].basis
    q = low - width * np.array([0.0, 0.5 * REACHES[1], REACHES[1], REACHES[0]])
    there = basis(States({"J3": q}, {"J3": "rad"}))
    np.testing.assert_allclose(there[:3], 1.0 / (q[:3] - low + 0.2 * width))
    assert there[3] == pytest.approx(there[2])


@pytest.mark.long
def test_within_its_ranges_nothing_changes() -> None:
    fitted = model(1, gp.effect_at("mine", "J4.moving", "Rz", gp.Expression("sin(2*J4)*J2")))
    frame = table(50, seed=1)
    poses = gp.read_table(frame, fitted.mechanism)
    whole, used = (predicted_columns(saved, poses) for saved in (fitted.saved, usable(fitted.saved)))
    np.testing.assert_array_equal(whole["x [mm]"], used["x [mm]"])
    assert set(used["outside"]) == {""}


def test_of_a_law_in_two_places_one_may_follow_the_session_alone() -> None:
    """An example is the standard error of a moment in the formula, which both of its terms contain."""
    terms = ("J3.moving", "Ry", "J3*abs(row - 30)"), ("J3.moving", "Rz", "abs(row - 30)")
    law = Effect("law", tuple(Term(slot, axis, gp.Expression(text)) for slot, axis, text in terms), "rad", "")
    measured = table(60, effects=("J3.moving:Ry:J3*abs(row - 30)=10 urad",))
    saved = gp.calibrate(gp.load_mechanism("irb6400r"), measured, [law], standard=("none",)).model.saved
    poses = unmeasured([j.name for j in saved.mechanism.joints], np.full((1, 6), 0.1))
    ended = [term.basis for term in usable(saved).model.effects[0].terms]
    states = prepare(saved.mechanism, poses).states
    np.testing.assert_allclose([basis(states)[0] for basis in ended], [3.0, 30.0])


@pytest.mark.long
def test_a_column_that_only_the_session_reads_is_not_asked_for() -> None:
    frame = table(60, effects=("J1.moving:Rz:clock=1e-6",), inputs={"clock": np.linspace(0.0, 600.0, 60)},
                  input_units={"clock": "s"})  # fmt: skip
    arm = gp.load_mechanism("irb6400r")
    fitted = gp.calibrate(arm, frame, ["J1.moving:Rz:clock"]).model
    assert fitted.of_its_session() == ("J1.moving:Rz:clock",)
    bare = frame.drop(columns="clock [s]")
    assert len(fitted.predict(bare)) == 60
    with pytest.raises(gp.InputError, match="column 'clock \\[s\\]' is missing"):
        fitted.predict(bare, session=True)
    assert fitted.misses(frame, session=True).mean() < fitted.misses(frame).mean()


@pytest.mark.long
def test_of_another_session_the_end_is_kept_however_the_law_is_written() -> None:
    """A drift written from the first row or from the last leaves the same registration behind, that of the last."""
    frame = table(60, effects=("J1.moving:Rz:row=3e-5",))
    arm = gp.load_mechanism("irb6400r")
    first, last = (gp.calibrate(arm, frame, [f"base:Tx:{law}"]).model for law in ("row", "row - 60"))
    points = [m.predict(frame)[[f"predicted_{c}" for c in LENGTHS]].to_numpy() for m in (first, last)]
    np.testing.assert_allclose(points[0], points[1], atol=1e-5)


@pytest.mark.long
def test_errors_of_the_instrument_are_predicted_where_nothing_was_measured() -> None:
    """They follow where the instrument would see the point, and say so beyond what it saw."""
    mechanism, truth = robot(80, seed=4, noise=0.0)
    seen = seen_columns(truth.dataset.position)
    off = 3e-4 * np.column_stack([seen["instrument_range"], np.zeros(80), seen["instrument_azimuth"]])
    data = replace(truth.dataset, position=truth.dataset.position + off)
    effects = ("instrument:Tz:instrument_azimuth", "instrument:Tx:instrument_range")
    found = gp.calibrate(mechanism, data, effects, holdout=0.0).model
    bare = replace(data, position=np.full_like(data.position, np.nan))
    predicted, tool = found.predict(bare, as_measured=True), found.predict(bare)
    np.testing.assert_allclose(predicted[LENGTHS].to_numpy() / 1e3, data.position, atol=2e-5)
    assert not predicted["outside"].any()
    poses = prepare(mechanism, data)
    observed = observe(found.saved.model, poses, found.saved.theta, found.saved.placement)
    rigid = placement_columns(found.saved, poses, observed).reshape(240, -1)
    rest = (tool[LENGTHS].to_numpy() / 1e3 - data.position + off).ravel()
    rest -= rigid @ np.linalg.lstsq(rigid, rest)[0]
    np.testing.assert_allclose(rest, 0.0, atol=2e-5)


def test_what_an_instrument_drifted_by_is_over_with_its_session() -> None:
    mechanism, truth = robot(80, seed=4, noise=0.0)
    drift = 2e-6 * (truth.dataset.row[:, None] - truth.dataset.row.mean()) * np.array([1.0, 0.0, 0.0])
    data = replace(truth.dataset, position=truth.dataset.position + drift)
    wave = f"instrument:Tx:row - {data.row.mean():g}"
    found = gp.calibrate(mechanism, data, [wave], holdout=0.0).model
    bare = replace(data, position=np.full_like(data.position, np.nan))
    later, session = found.predict(bare, as_measured=True), found.predict(bare, session=True)
    np.testing.assert_allclose(later[LENGTHS].to_numpy() / 1e3, truth.dataset.position, atol=2e-5)
    np.testing.assert_allclose(session[LENGTHS].to_numpy() / 1e3, data.position, atol=2e-5)
    assert (found.of_its_session(), found.of_its_session(session=True)) == ((), (wave,))


def test_of_a_tool_that_slipped_the_prediction_is_where_it_is_now() -> None:
    """Row 1 alone and row 90 alone are both predicted with the tool as it was left: a millimetre on, not half of it."""
    arm = gp.load_mechanism("irb6400r")
    effect = "tool slipped after row 45, Tx"
    made = gp.simulate(arm, [f"{effect}=1 mm"], poses=90, noise="0.02 mm", seed=3)
    found = gp.calibrate(arm, made.table, [effect], holdout=0.0).model
    first, last = (found.misses(made.table.subset([row])) for row in (0, 89))
    assert last[0] < 0.1
    assert first[0] == pytest.approx(1.0, abs=0.1)
    assert found.misses(made.table, session=True).max() < 0.15


@pytest.mark.long
@pytest.mark.parametrize("point", POINTS)
@pytest.mark.parametrize("effect", ["tool slipped after row 45, Tx", "set-up moved after row 45, Tz"])
def test_what_slipped_or_moved_is_a_place_that_no_joint_is_to_undo(effect: str, point: Point) -> None:
    arm = gp.load_mechanism("irb6400r")
    made = gp.simulate(arm, [f"{effect}=1 mm"], poses=90, noise="0.02 mm", seed=3)
    found = gp.calibrate(arm, made.table, [effect], holdout=0.0).model
    assert found.saved.model.effects[-1].name == effect
    still = gp.Model(replace(found.saved, theta=np.append(found.saved.theta[:-1], 0.0)))
    targets = made.table.subset(np.arange(0, 90, 9))
    moved, unmoved = (m.compensate(targets, point=point).filter(regex="corrected") for m in (found, still))
    np.testing.assert_allclose(moved, unmoved, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb6400r", "hexapod"])
@pytest.mark.parametrize("what", ["tool slipped after row 45, Tx=1 mm", "set-up moved after row 45, Rx=1 mrad"])
def test_where_tool_and_robot_are_now_predicts_the_same(name: str, what: str) -> None:
    arm = gp.load_mechanism(name)
    made = gp.simulate(arm, [what], poses=60, noise="0.02 mm", seed=3)
    left = usable(gp.calibrate(arm, made.table, [what.split("=")[0]], holdout=0.0).model.saved)
    placed = at_end(left)
    assert len(placed.theta) == len(left.theta) - 1
    points = [pd.DataFrame(predicted_columns(saved, made.table))[LENGTHS].to_numpy() for saved in (left, placed)]
    np.testing.assert_allclose(points[0], points[1], atol=1e-9)


@pytest.mark.long
def test_many_poses_are_predicted_in_parts_that_remember_those_before(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, frame = gp.load_mechanism("irb6400r"), table(40, seed=1)
    fitted = gp.calibrate(arm, gp.read_table(frame, arm, in_order=True), ["play_last_move J2"], holdout=0.0).model
    whole = fitted.predict(frame, in_order=True)
    monkeypatch.setattr("gpmodel.application.predict.AT_ONCE", 7)
    said: list[str] = []
    parts = fitted.predict(frame, in_order=True, progress=lambda line: said.append(str(line)))
    assert fitted.saved.theta[-1] != 0.0
    np.testing.assert_allclose(parts.filter(regex="predicted|sigma"), whole.filter(regex="predicted|sigma"), rtol=1e-12)
    assert said[0] == "0 of 40 poses predicted"
    assert len(said) == 6


NOISE = 3e-5


def fresh(poses: Poses, truth: Truth, rng: np.random.Generator) -> Poses:
    """Poses anywhere within the measured ranges, measured with the same noise."""
    data: Dataset = poses.dataset.subset(rng.integers(0, len(poses), POSES))
    data = replace(data, q=rng.uniform(poses.dataset.q.min(axis=0), poses.dataset.q.max(axis=0), data.q.shape))
    there = prepare(truth.model.mechanism, data)
    tip = observe(truth.model, there, truth.theta, truth.placement).tip[:, :3, 3]
    return replace(there, dataset=replace(data, position=tip + NOISE * rng.normal(size=tip.shape)))


@pytest.mark.long
@pytest.mark.parametrize("count", [40, 100])
def test_the_bounds_hold_on_further_poses_and_are_no_wider_than_they_must(count: int) -> None:
    held, over = [], []
    for seed in range(12):
        truth = measure("ur5", (), (), seed, count=count, noise=NOISE)
        fit = calibrate(truth.model, truth.poses)
        found = further_poses(fit, truth.poses)
        assert found is not None
        errors = errors_on(fit, fresh(truth.poses, truth, np.random.default_rng(seed)))
        there = [np.sqrt(np.mean(errors**2)), np.percentile(errors, 95), errors.max()]
        bounds = [1e-3 * b.bound_mm for b in (found.rms, found.within_95, found.largest)]
        held += [t <= b for t, b in zip(there, bounds, strict=True)]
        over.append(bounds[0] / there[0])
        assert found.rms.typical_mm < found.rms.bound_mm
    assert np.mean(held) > 0.85
    assert np.median(over) < 1.3


def test_repeats_of_few_poses_are_worth_less_than_as_many_poses() -> None:
    truth = measure("ur5", (), (), 3, count=60, noise=NOISE)
    fit = calibrate(truth.model, truth.poses)
    assert fit.freedom == 180 - fit.rank
    few = truth.poses.subset(np.arange(12))
    assert further_poses(calibrate(truth.model, few), few) is None


def test_each_pose_is_left_out_of_a_fit_of_the_geometry_once() -> None:
    saved, dataset = fitted("geometry")
    rigid = refitted(saved)
    fitted_to = root_mean_square(calibrate(saved.model, prepare(saved.mechanism, dataset)).error)
    assert len(rigid.heldout) == len(dataset)
    assert fitted_to < root_mean_square(rigid.heldout) < 3.0 * fitted_to
    assert "Error on held-out poses" in note_of(rigid, "calibrated.urdf")


ARM = "ur5"
FOUND, RIVAL = (f"{kind}, shoulder_lift_joint" for kind in ("eccentricity, 1 per turn", "joint compliance"))
OTHER = "base compliance"


@cache
def doubted() -> tuple[Calibration, Calibration, Poses, CauseSet]:
    """A compliance and a tilt of the base, fitted with a wave at the shoulder and with the compliance; the place of the
    wave, where the compliance is three times in ten."""
    arm, data = mechanism(ARM), bare(ARM, 120, 3, payload=False)
    pool = {c.name: c for c in catalogue.candidates(arm, prepare(arm, data).states)}
    planted = [*pool[RIVAL].effects, *pool[OTHER].effects]
    theta = np.concatenate([sized(ARM, pool[name].effects, data, 0.2) for name in (RIVAL, OTHER)])
    truth = measure(ARM, planted, theta, 3, dataset=data)
    held: dict[str, float] = {}

    def with_(name: str) -> Calibration:
        model = ErrorModel(arm, (*geometric_effects(arm), *pool[OTHER].effects, *pool[name].effects))
        fit = calibrate(model, truth.poses, robust=False, **held)
        held["condition_limit"] = fit.condition_limit
        return fit

    fit, instead = with_(FOUND), with_(RIVAL)
    residual = residual_of(fit, truth.poses, Criteria(), FOLD_SEED)
    place = causes_of(residual, pool[FOUND], [pool[RIVAL]])
    (other,) = (cause for cause in place.others if cause.effects == pool[RIVAL].effects)
    return fit, instead, truth.poses, replace(place, others=(replace(other, probability=0.3),))


@pytest.mark.long
def test_every_standard_error_is_the_root_of_the_total_variance_of_fits_with_each_cause() -> None:
    """Σ p (σ² + (value - stated)²) of the geometry, of the other finding, of registration and tool."""
    fit, instead, poses, place = doubted()
    stated = with_cause_variance(fit, poses, [place])
    common = len(geometric_effects(fit.model.mechanism)) + 1
    values, others, stderr, theirs, both = (
        np.array([*numbers[:common][fit.free[:common]], *(getattr(p, what) for p in one.placement_numbers)])
        for one, numbers, what in (
            (fit, fit.theta, "value"), (instead, instead.theta, "value"), (fit, fit.stderr, "stderr"),
            (instead, instead.stderr, "stderr"), (stated, stated.stderr, "stderr"),
        )
    )  # fmt: skip
    total = np.sqrt(0.7 * stderr**2 + 0.3 * (theirs**2 + (others - values) ** 2))
    assert (total > 1.5 * stderr).sum() >= 4
    np.testing.assert_allclose(both, total, rtol=0.1)
    np.testing.assert_array_equal(stated.theta, fit.theta)


@pytest.mark.long
def test_the_standard_error_of_a_finding_holds_if_it_is_the_cause() -> None:
    fit, _, poses, place = doubted()
    stated = with_cause_variance(fit, poses, [place])
    own = [name in place.own for name in (e.name for e in fit.model.effects)]
    np.testing.assert_allclose(stated.stderr[own], fit.stderr[own], rtol=1e-9)


@pytest.mark.long
def test_a_prediction_is_uncertain_by_what_another_cause_would_make_of_it(tmp_path: Path) -> None:
    """Where the arm was measured both causes predict nearly the same, although their parameters differ by far."""
    fit, instead, poses, place = doubted()
    stated = with_cause_variance(fit, poses, [place])
    new = bare(ARM, 300, 9, payload=False)
    tips = [observed_by(saved_model(one, poses), prepare(fit.model.mechanism, new))[1].tip for one in (fit, instead)]
    apart = 0.3 * (tips[0] - tips[1])[:, :3, 3] ** 2
    save_model(tmp_path / "model.json", saved_model(stated, poses))
    saved, alone = load_model(tmp_path / "model.json", fit.model.mechanism), saved_model(fit, poses)
    at, observed = observed_by(alone, prepare(fit.model.mechanism, new))
    one, both = (coordinate_deviations(usable(model), at, observed) ** 2 for model in (alone, saved))
    assert np.mean(both - one) == pytest.approx(np.mean(apart), rel=0.35)


@pytest.mark.long
def test_where_nothing_else_is_likely_nothing_changes() -> None:
    fit, _, poses, place = doubted()
    rare = replace(place, others=tuple(replace(cause, probability=5e-4) for cause in place.others))
    assert with_cause_variance(fit, poses, [rare]) is fit
    assert with_cause_variance(fit, poses, [replace(place, others=())]) is fit


@pytest.mark.long
@pytest.mark.parametrize("seed", [92, 94, 95])
def test_the_radius_of_a_ball_allows_for_lobes_of_any_number_and_for_those_that_are_not_found(seed: int) -> None:
    """Three lobes and an offset look like other lobes, or like another radius: 6, 22 and 27 standard errors off."""
    off, wider = [], []
    for kind in ("lobes", "nothing"):
        rig, data = rig_of(seed, kind, True)
        nothing = np.zeros(0, dtype=np.int64)
        found = discover(JOINT, prepare(JOINT, data), np.arange(60), nothing, search=Search(runs=0, workers=1))
        alone, both = (
            next(p for p in one.final.placement_numbers if p.name == "tool z") for one in (found, over_causes(found))
        )
        off.append(abs(both.value - rig.joint.tooling_ball[2] + JOINT.tooling_ball[2]) / both.stderr)
        wider.append(both.stderr / alone.stderr)
    assert max(off) < 3.0
    assert wider[0] > 2.0
    assert wider[1] < 1.05
