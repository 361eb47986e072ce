"""Test inputs that users of other libraries write by habit."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import robot, table
from matplotlib.figure import Figure

import gpmodel as gp
from gpmodel.api.results import write_fitted
from gpmodel.executor import Forks
from gpmodel.report.schema import SCHEMA, Report


@pytest.fixture(scope="module")
def fit() -> gp.Model:
    return gp.calibrate("irb6400r", table(60, effects=("base_compliance=5e-8",)), ["base_compliance"])


@pytest.fixture(scope="module")
def found() -> object:
    effects = ("gear_harmonic J2=1e-3",)
    return gp.discover("irb6400r", table(60, effects=effects), search=gp.Search(runs=0, workers=1), holdout=0.3)


@pytest.mark.long
def test_columns_of_a_file_come_back_as_numbers(fit: gp.Model, tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    table(60).assign(note="a").to_csv(path, index=False)
    for frame in (fit.predict(path), fit.model.compensate(path)):
        assert frame["J1 [deg]"].mean() == pytest.approx(pd.read_csv(path)["J1 [deg]"].mean())
        assert frame["note"].tolist() == ["a"] * 60


def test_joint_values_may_be_an_array(fit: gp.Model) -> None:
    dataset = gp.read_table(table(60), fit.model.mechanism)
    points = [fit.predict(poses)["x [mm]"].to_numpy() for poses in (dataset.q,)]
    np.testing.assert_allclose(points[0], fit.predict(dataset)["predicted_x [mm]"], atol=1e-6)
    with pytest.raises(gp.InputError, match="an array of 60 x 5"):
        fit.predict(dataset.q[:, :5])


@pytest.mark.parametrize("noise", [0.05, 1])
def test_a_length_without_a_unit_is_refused(noise: float) -> None:
    arm = gp.load_mechanism("irb6400r")
    for call in (lambda: gp.discover(arm, table(60), noise=noise), lambda: gp.simulate(arm, noise=noise)):
        with pytest.raises(gp.InputError, match=r"noise: .* has no unit, expected a length as text, as in '.* mm'"):
            call()


def test_numbers_of_a_fit_are_at_hand(fit: gp.Model) -> None:
    names = [e.name for e in fit.model.saved.model.effects]
    assert list(fit.params.index) == list(fit.stderr.index) == names
    assert fit.params["base compliance"] == pytest.approx(5e-8, rel=0.3)
    own = fit.covariance.loc[names, names].to_numpy()
    np.testing.assert_allclose(np.sqrt(np.diag(own)), np.nan_to_num(fit.stderr), rtol=1e-6, atol=1e-15)
    left = fit.residuals
    np.testing.assert_allclose(np.linalg.norm(left[["x [mm]", "y [mm]", "z [mm]"]], axis=1), left["error [mm]"])
    assert 0.01 < fit.rms < 0.2


@pytest.mark.long
def test_results_draw_and_print_themselves(fit: gp.Model, found: gp.Model) -> None:
    for result in (fit, found):
        assert isinstance(result.plot(), Figure)
        page = result._repr_html_()
        assert page.count("<table") >= 1
        assert "<svg" in page
        assert "var(--ink)" not in page or "--ink:" in page
    with pytest.raises(gp.InputError, match="is no picture of this result; available: error_histogram, "):
        fit.plot("nothing")
    assert next(iter(found.histogram.columns)) == "input"


@pytest.mark.long
def test_what_is_long_says_itself_in_a_line(found: gp.Model) -> None:
    dataset = gp.read_table(table(60), gp.load_mechanism("irb6400r"))
    assert repr(dataset) == "<table data frame: 60 poses of J1, J2, J3, J4, J5, J6, 60 with x, y, z>"
    said = repr(found.findings[0])
    assert "\n" not in said
    assert len(said) < 200
    assert said.startswith("<effect ")


def test_a_table_is_sliced_and_becomes_a_data_frame() -> None:
    dataset = gp.read_table(table(60), gp.load_mechanism("irb6400r"))
    assert len(dataset[:10]) == 10
    again = gp.read_table(dataset.to_dataframe().drop(columns="row"), gp.load_mechanism("irb6400r"))
    np.testing.assert_allclose(again.q, dataset.q, atol=1e-12)
    np.testing.assert_allclose(again.position, dataset.position, atol=1e-12)
    with pytest.raises(gp.InputError, match="expected a slice"):
        dataset["J1"]


def test_two_loads_of_one_model_are_equal(fit: gp.Model, tmp_path: Path) -> None:
    fit.model.save(tmp_path / "m.json")
    first, second = gp.load_model(tmp_path / "m.json"), gp.load_model(tmp_path / "m.json")
    assert first == second
    assert len({first, second}) == 1
    assert first != gp.calibrate("irb6400r", table(40, seed=3)).model


@pytest.mark.long
def test_one_rule_for_the_share_held_out() -> None:
    for share in (0, 0.0, 1.0, 1.5):
        with pytest.raises(gp.InputError, match="expected a share above 0 and below 1"):
            gp.discover("irb6400r", table(60), holdout=share)


def test_a_report_that_fails_leaves_the_model_and_one_line(fit: gp.Model, tmp_path: Path) -> None:
    def fails() -> Report:
        raise gp.InputError("legs do not meet (pose 192)")

    with pytest.raises(gp.InputError, match=r"no report could be made \(legs .*\); the model .* in .*R.model\.json"):
        write_fitted(fails, fit.model, tmp_path / "R", Forks(1))
    assert [path.name for path in (tmp_path / "R").iterdir()] == ["model.json"]
    assert gp.load_model(tmp_path / "R" / "model.json").mechanism.name == fit.model.mechanism.name


@pytest.mark.long
def test_what_was_written_is_read_compared_explained_certified_and_exported(found: gp.Model, tmp_path: Path) -> None:
    found.report(tmp_path / "R")
    again = gp.load_result(tmp_path / "R")
    assert again.verdict == found.verdict
    assert again.model == gp.load_result(tmp_path / "R").model
    assert list(again.histogram.columns) == ["input", "shuffled", "p_value", "significant"]
    assert again.findings == found.findings
    assert len(again.ladder()) == len(found.ladder())
    gp.compare(found, again).report(tmp_path)
    assert (tmp_path / "compare.html").is_file()
    assert found.findings[0].name in gp.explain(again, 1).summary()
    gp.certificate(found, machine="Cell 4").report(tmp_path)
    assert "Cell 4" in (tmp_path / "certificate.html").read_text()
    for result, schema in ((again, SCHEMA), (gp.compare(found, again), 1), (gp.explain(again, 1), 1)):
        assert result.summary()
        result.save(tmp_path / "saved.json")
        assert json.loads((tmp_path / "saved.json").read_text())["schema"] == schema
    gp.export(tmp_path / "R", tmp_path / "E")
    assert (tmp_path / "E" / "exports" / "model.py").is_file()
    for call in (lambda: gp.compare(1, again), lambda: gp.explain(again, 99), lambda: gp.export(3),
                 lambda: gp.load_result(tmp_path), lambda: gp.certificate(found, mashine="x")):  # fmt: skip
        with pytest.raises(gp.InputError):
            call()


def test_a_certificate_prints_and_saves_the_numbers_of_its_page(fit: gp.Model, tmp_path: Path) -> None:
    certified = gp.certificate(fit, machine="Cell 4", tolerance="1 um")
    said = certified.summary()
    assert max(map(len, said.splitlines())) <= 80
    certified.save(tmp_path / "c.json")
    certified.report(tmp_path)
    kept, page = json.loads((tmp_path / "c.json").read_text()), (tmp_path / "certificate.html").read_text()
    assert dict(kept["particulars"])["machine"] == "Cell 4"
    assert dict(kept["scope"])["tolerance"].startswith("fail: ")
    for name, before, after in kept["statistics"]:
        assert re.search(rf"{re.escape(name)} +{before} +{after}$", said, re.MULTILINE)
        assert f'<td>{before}</td><td class="main">{after}</td>' in page
    assert kept["effects"][0][0] in said
    with pytest.raises(gp.InputError, match="cannot be written"):
        certified.save(tmp_path)


def test_which_point_is_compensated_is_said_and_may_be_chosen(fit: gp.Model) -> None:
    """With a frame, the target is the position of the flange. Both differ by the tool's length, and agree on joint
    targets except for the named point of the correction.
    """
    mechanism = fit.model.mechanism
    target = pd.DataFrame({"x [mm]": [1500.0], "y [mm]": [100.0], "z [mm]": [1400.0]})
    names = [f"corrected_{j.name} [deg]" for j in mechanism.joints]
    tool, frame = (fit.model.compensate(target, point=p, max_move=90.0)[names] for p in ("tool", "frame"))
    assert np.abs(tool.to_numpy() - frame.to_numpy()).max() > 1.0
    joints = pd.DataFrame({f"J{i} [deg]": [5.0 * i] for i in range(1, 7)})
    same = [fit.model.compensate(joints, point=p)[names].to_numpy(dtype=float) for p in ("tool", "frame")]
    np.testing.assert_allclose(*same, atol=1e-5)
    with pytest.raises(gp.InputError, match="point: 'flange', expected tool or frame"):
        fit.model.compensate(target, point="flange")


def test_targets_whose_side_of_play_the_correction_turns_say_so() -> None:
    """Moves smaller than the corrections come from either side."""
    arm, made = robot(60, seed=2)
    effect = gp.effect_at("play", "J3.moving", "Ry", gp.Expression("last_move_J3"))
    model = gp.calibrate(arm, replace(made.dataset, in_order=True), [effect], holdout=0.0).model
    steps = np.tile(np.radians([10.0, -20.0, 15.0, 30.0, 50.0, 20.0]), (12, 1))
    steps[:, 1] += 0.4 * np.sin(2.0 * np.arange(12))
    steps[:, 2] += 6e-4 * np.arange(12)
    found = model.compensate(steps, in_order=True)
    assert set(found["status"]) == {"ok", "side of play open"}
    assert found["corrected_J3 [deg]"].notna().all()


def test_joint_values_of_compensate_beside_those_of_the_poses_are_refused(fit: gp.Model) -> None:
    """A fit could otherwise take the targets for the joint values at which the rows were measured."""
    measured = table(30, effects=("base_compliance=5e-8",))
    corrected = fit.model.compensate(measured)
    for command in (gp.check, gp.calibrate, gp.discover):
        with pytest.raises(gp.InputError, match="'J1' and 'corrected_J1': at which of them was the row measured"):
            command("irb6400r", corrected)
    assert fit.model.verify(corrected).record.data.counted
