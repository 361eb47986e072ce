"""Test that the errors stated by a result equal the errors of its model.json, computed by the public API."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, robot, table
from instances import some

import gpmodel as gp
from gpmodel.api.calibrate import CalibrationResult
from gpmodel.api.model import Model
from gpmodel.application.exports.forward import forward_of
from gpmodel.application.exports.rigid import refitted
from gpmodel.application.exports.sample import Place
from gpmodel.application.exports.sources import header_text, latex_text, numpy_text
from gpmodel.application.further import heldout_fits
from gpmodel.application.model_file import saved_model
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.se3 import exp, rotation_vector
from gpmodel.report.certificate import errors_before_and_after
from gpmodel.report.poses import csv
from gpmodel.report.verdict import behind
from gpmodel.table.cells import frame_of

EXACT = 1e-6
"""Millimetres."""


def _parted(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    return frame.assign(**{column: np.where(np.arange(len(frame)) % 2, "A", "B")})


CASES: dict[str, tuple[Callable[[], pd.DataFrame], tuple[str, ...], bool]] = {
    "arm": (lambda: table(44, name="ur5"), (), False),
    "set-ups": (lambda: _parted(table(60, name="ur5"), "setup"), (), False),
    "tools": (lambda: _parted(table(60, name="ur5"), "tool"), (), False),
    "payload": (lambda: table(44, payload=np.linspace(0.0, 60.0, 44)), ("base_compliance",), False),
    "instrument": (lambda: table(44, name="ur5"), ("instrument_range",), True),
}
"""Tables, the effects of their calibration, and whether plain predictions differ from readings."""


@cache
def made(case: str) -> tuple[pd.DataFrame, CalibrationResult]:
    build, effects, _ = CASES[case]
    frame = build()
    return frame, gp.calibrate("irb6400r" if case == "payload" else "ur5", frame, effects)


def errors(model: Model, frame: pd.DataFrame, rows: np.ndarray, session: bool) -> np.ndarray:
    """3-D error, mm, of the predictions of some rows, of which all are predicted."""
    found = model.predict(frame, session=session)
    measured = np.column_stack([numbers(frame, f"{a} [mm]") for a in "xyz"])
    predicted = np.column_stack([found[f"predicted_{a} [mm]"] for a in "xyz"])
    return np.asarray(np.linalg.norm(measured - predicted, axis=1)[rows])


@pytest.mark.first(1)
@pytest.mark.parametrize("case", some(CASES, "arm", "instrument"))
def test_report_and_certificate_state_the_errors_of_the_saved_model(case: str, tmp_path: Path) -> None:
    frame, result = made(case)
    ladder, record = result.calibrated, result.record
    held = np.setdiff1d(np.arange(len(frame)), ladder.train)
    result.model.save(tmp_path / "model.json")
    whole = gp.load_model(tmp_path / "model.json")
    without = Model(saved_model(ladder.steps[-1].calibration, ladder.poses.subset(ladder.train)))
    without.save(tmp_path / "without.json")
    without = gp.load_model(tmp_path / "without.json")
    everything, said = np.arange(len(frame)), record.predicted
    assert said is not None
    for model, rows, session, stated in (
        (without, held, True, record.ladder[-1].heldout),
        (without, held, True, said.heldout_as_measured),
        (without, held, False, said.heldout),
        (whole, everything, True, said.model_as_measured),
        (whole, everything, False, said.model),
    ):
        found = errors(model, frame, rows, session)
        assert stated.rms_mm == pytest.approx(root_mean_square(found), abs=EXACT)
        assert stated.max_mm == pytest.approx(found.max(), abs=EXACT)
    certified = errors_before_and_after(record)
    assert certified is not None
    stated_after = np.sort(certified[:, 1])
    assert stated_after == pytest.approx(np.sort(errors(without, frame, held, True)), rel=1e-5)
    assert said.differs is CASES[case][2]
    assert ("predict without an option" in result.summary()) is CASES[case][2]


@pytest.mark.long
def test_a_choice_in_folds_states_the_errors_of_each_model_at_the_poses_it_has_not_seen(tmp_path: Path) -> None:
    frame = table(60, name="ur5")
    result = gp.discover("ur5", frame, folds=3, search=gp.Search(runs=0), candidates=gp.catalogue[:1])
    found = np.full(len(frame), np.nan)
    for part in heldout_fits(result.found):
        Model(saved_model(part.fit, part.train)).save(tmp_path / "part.json")
        rows = part.heldout.dataset.row - 1
        found[rows] = errors(gp.load_model(tmp_path / "part.json"), frame, rows, True)
    assert len(heldout_fits(result.found)) == 3
    assert result.record.ladder[-1].heldout.rms_mm == pytest.approx(root_mean_square(found), abs=EXACT)
    result.model.save(tmp_path / "model.json")
    whole = errors(gp.load_model(tmp_path / "model.json"), frame, np.arange(len(frame)), False)
    assert result.record.predicted is not None
    assert result.record.predicted.model.rms_mm == pytest.approx(root_mean_square(whole), abs=EXACT)


NOISE = 2e-4
"""rad, each component."""


def measured(poses: int, seed: int, rotations: bool = True) -> pd.DataFrame:
    mechanism, made = robot(poses, seed)
    if not rotations:
        return frame_of(made.dataset, mechanism)
    tip = observe(made.model, prepare(mechanism, made.dataset), made.theta, made.placement).tip[:, :3, :3]
    noise = np.random.default_rng(seed).normal(0.0, NOISE, (poses, 3))
    turned = rotation_vector(exp(np.hstack([np.zeros((poses, 3)), noise]))[:, :3, :3] @ tip)
    frame = frame_of(made.dataset, mechanism).astype(float)
    return frame.assign(**{f"r{a} [deg]": np.degrees(turned[:, k]) for k, a in enumerate("xyz")})


@pytest.fixture(scope="module")
def fit() -> "gp.CalibrateResult":
    return gp.calibrate("irb6400r", measured(40, 1), holdout=0.3)


@pytest.mark.long
def test_the_report_has_the_error_of_orientation_before_and_after(fit: "gp.CalibrateResult") -> None:
    kinds = {kind.name: kind for kind in fit.record.readings}
    found = kinds["orientation"]
    assert found.unit == "mrad"
    assert found.before is not None
    assert found.after is not None
    assert found.before > 2.0 * found.after
    drawn = 1e3 * root_mean_square(np.random.default_rng(1).normal(0.0, NOISE, (40, 3)))
    assert 0.8 * drawn < found.after / np.sqrt(3.0) < 1.5 * drawn
    assert f"{found.before:.3g} → {found.after:.3g} mrad" in fit.summary()
    assert f"{found.before:.3g} → {found.after:.3g} mrad RMS on held-out poses" in behind(fit.record)


def test_it_is_told_as_a_length_at_the_tool_point(fit: "gp.CalibrateResult") -> None:
    found = next(kind for kind in fit.record.readings if kind.unit == "mrad")
    tool = {p.name: p.value for p in fit.record.placement}
    lever = np.linalg.norm([tool[f"tool {axis}"] for axis in "xyz"])
    assert found.after is not None
    said = f"{found.after * lever:.3f} mm at {1e3 * lever:.0f} mm from the flange"
    assert said in behind(fit.record)


def test_the_ladder_has_it_step_by_step(fit: "gp.CalibrateResult") -> None:
    found = next(kind for kind in fit.record.readings if kind.unit == "mrad")
    first, last = (fit.record.turn_mrad(fit.record.ladder[k]) for k in (0, -1))
    assert (first, last) == pytest.approx((found.before, found.after), rel=1e-6)
    lines = fit.summary().splitlines()
    head = next(line for line in lines if line.endswith("mrad"))
    below = [line.split()[-1] for line in lines[lines.index(head) + 1 :] if line.strip() and line[-1].isdigit()]
    assert [float(text) for text in below[:2]] == pytest.approx([found.before, found.after], rel=1e-2)
    assert max(map(len, lines)) <= 80


def test_poses_csv_has_it_pose_by_pose(fit: "gp.CalibrateResult", tmp_path: Path) -> None:
    (tmp_path / "poses.csv").write_text(csv(fit.record))
    poses = pd.read_csv(tmp_path / "poses.csv")
    held = poses[poses["set"] == "held out"]
    found = next(kind for kind in fit.record.readings if kind.unit == "mrad")
    assert np.sqrt(np.mean(held["after [mrad]"] ** 2)) == pytest.approx(found.after, rel=1e-3)


@pytest.mark.long
def test_the_verdict_compares_orientations_of_the_steps_whose_positions_it_compares(fit: "gp.CalibrateResult") -> None:
    named = gp.calibrate("irb6400r", measured(40, 1), ["joint_compliance J2"], holdout=0.3).record
    for record, before in ((fit.record, "registration only"), (named, "standard model")):
        assert f": {before} " in record.verdict
        assert f"Orientation: {before} " in behind(record)
    standard = named.turn_mrad(named.ladder[-2])
    assert standard is not None
    assert f"standard model {standard:.3g} → " in behind(named)


@pytest.mark.long
def test_certificate_and_verification_state_it(fit: "gp.CalibrateResult") -> None:
    later = fit.model.verify(measured(40, 1).iloc[:30].assign(**{"x [mm]": lambda d: d["x [mm]"] + 1e-3}))
    there = f"at {1e3 * fit.model.saved.lever:.0f} mm from the flange"
    for text in (gp.certificate(fit).summary(), later.summary(), gp.certificate(later).summary()):
        said = " ".join(text.split())
        assert "mrad" in said
        assert there in said


@pytest.mark.long
def test_it_stands_nowhere_without_orientations() -> None:
    plain = gp.calibrate("irb6400r", measured(40, 1, rotations=False))
    assert not plain.record.readings
    assert "[mrad]" not in csv(plain.record)


ROWS = """convention = "standard"
[[joint]]
name = "shoulder"
d_mm = 300
alpha_deg = 90
[[joint]]
name = "elbow"
a_mm = 500
"""


@cache
def arm() -> LoadedMechanism:
    return MechanismChoice("arm.toml", description=ROWS).load()


@cache
def fitted(slot: str = "J2.moving", angle: str = "J2") -> CalibrationResult:
    made = gp.simulate(arm(), ["elbow.moving:Ry:sin(elbow)=0.001 rad"], poses=30, noise="0.02 mm")
    table = made.to_dataframe().rename(columns={"shoulder [deg]": "J1 [deg]", "elbow [deg]": "J2 [deg]"})
    drag = gp.effect_at("drag at elbow", slot, "Ry", gp.Expression(f"sin({angle})"))
    return gp.calibrate(arm(), table, [drag], holdout=0.0)


@pytest.mark.long
@pytest.mark.parametrize(("slot", "angle"), [("J2.moving", "J2"), ("elbow.moving", "elbow"), ("elbow.moving", "J2")])
def test_a_slot_and_an_input_are_named_as_the_table_or_the_mechanism_does(slot: str, angle: str) -> None:
    effect = fitted(slot, angle).record.effects[0]
    assert effect.value == pytest.approx(0.001, rel=0.1)
    assert [(t.slot, t.basis) for t in effect.terms] == [("J2.moving", "sin(J2)")]
    assert effect.name == "drag at J2"


def test_written_out_effects_take_both_names_and_unknown_ones_are_refused() -> None:
    made = [gp.simulate(arm(), [f"{n}.moving:Ry:sin({n})=0.001 rad"], poses=5).to_dataframe() for n in ("J2", "elbow")]
    assert made[0].equals(made[1])
    with pytest.raises(gp.InputError, match=r"slot 'J3\.moving' is unknown"):
        gp.simulate(arm(), ["J3.moving:Ry:sin(elbow)=0.001 rad"], poses=5)


@pytest.mark.long
def test_next_poses_and_exports_are_in_the_names_of_the_table() -> None:
    model = fitted().model
    assert list(gp.choose_poses(count=2, after=model).to_dataframe()) == ["J1 [deg]", "J2 [deg]"]
    assert refitted(model.saved).missing == ("drag at J2",)
    forward = forward_of(model.saved, Place.of(model.saved, None, None))
    assert "JOINTS = ['J1', 'J2']" in numpy_text(forward, "")
    assert "q: J1, J2. " in header_text(forward, "")
    assert "J2.moving" in latex_text(forward)
    assert "elbow" not in latex_text(forward)


@pytest.mark.long
def test_a_search_tells_its_progress_in_the_names_of_the_table() -> None:
    table, told = fitted().model.saved.measured, []
    assert table is not None
    drag = gp.effect_at("drag at elbow", "J2.moving", "Ry", gp.Expression("sin(J2)"))
    found = gp.discover(
        arm(), table.dataset, candidates=(drag,), search=gp.Search(runs=0), holdout=0.3, progress=told.append
    )
    assert [f.name for f in found.findings] == ["drag at J2"]
    assert "round 1: added drag at J2" in [str(line) for line in told]


def test_the_numbers_of_a_fit_are_named_as_the_table_does() -> None:
    fit = fitted()
    names = list(fit.params.index)
    assert "J1 Tx" in names
    assert not any(name.startswith(("shoulder", "elbow")) for name in names)
    assert list(fit.stderr.index) == names == list(fit.covariance.columns)[-len(names) :]
