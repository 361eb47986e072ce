"""Test that files that are no valid model are refused with the place in the file."""

import json
import shutil
from copy import deepcopy
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from effect_cases import bare, mechanism
from group_cases import STANDING, offered
from model_cases import CASES, fitted, refused, sealed

import gpmodel as gp
from gpmodel.application.compensate import compensate, joint_targets
from gpmodel.application.kinematics import with_model_labels
from gpmodel.application.model_file import check_kept, load_model, model_text, save_model, unfitted
from gpmodel.application.model_reader import LARGEST_FILE, EffectPart
from gpmodel.application.predict import predicted_columns
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States
from gpmodel.selection.group import Shapes
from gpmodel.selection.offers import Offering
from gpmodel.table.cells import joint_table
from gpmodel.texts import SEAL


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb6400r", "panda", "spherical-joint"])
def test_every_effect_that_can_be_found_can_be_kept(name: str) -> None:
    """The bounds of a file are wider than whatever the product offers to put in it."""
    arm, data = mechanism(name), bare(name, 60, in_order=True)
    groups = offered(Offering(STANDING), arm, Shapes(prepare(arm, data).states))
    assert len(groups) > 20
    for effect in {e for g in groups for e in g.effects}:
        terms = [{"slot": t.slot, "axis": t.axis, "basis": str(t.basis), "weight": t.weight} for t in effect.terms]
        said = {"name": effect.name, "family": effect.family, "unit": effect.unit, "terms": terms}
        msgspec.convert(said | {"prior": None, "value": 1.0, "stderr": None}, EffectPart)


def test_an_effect_that_no_file_may_hold_is_refused_before_anything_is_searched() -> None:
    arm = mechanism("irb6400r")
    good = gp.effect_at("cable drag", "J4.moving", "Ry", gp.Expression("sin(J4)"))
    check_kept(good)
    for field, value in (("unit", "mm; rm -rf"), ("name", 'a "quoted" name'), ("family", "line\nbreak")):
        with pytest.raises(InputError, match=rf"could not be kept in a model file: {field}: Expected") as caught:
            check_kept(replace(good, **{field: value}))
        assert "\n" not in str(caught.value)
    table = gp.simulate(arm, ["gear_harmonic J4=60 arcsec"], poses=30, seed=0).table
    odd = gp.Family("drag", "a cable", "own", lambda mechanism, states: [replace(good, unit="mm; rm -rf")])
    with pytest.raises(InputError, match="candidates: effect 'cable drag' could not be kept in a model file: unit"):
        gp.discover(arm, table, candidates=(odd,), search=gp.Search(runs=0))


def test_a_model_is_read_back_as_it_is_written(tmp_path: Path) -> None:
    saved = fitted("load")[0]
    save_model(tmp_path / "model.json", saved)
    first, *others = saved.model.effects
    odd = replace(saved, model=ErrorModel(saved.mechanism, (replace(first, unit="mm; rm -rf"), *others)))
    with pytest.raises(InputError, match=r"^model.json is not written, .*read back: effects\[0\].unit: Expected"):
        save_model(tmp_path / "model.json", odd)
    assert load_model(tmp_path / "model.json").sigma == saved.sigma


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    return dict(json.loads(model_text(fitted("load")[0])))


WHOLE: dict[str, tuple[str, str]] = {
    "no JSON": ("{", "is no JSON"),
    "too deep": ("[" * 100_000, "nested too deep"),
    "not a number": ('{"kind": NaN}', "NaN is no finite number"),
    "too large a number": ('{"kind": 1e999}', "1e999 is no finite number"),
    "a long number": ('{"kind": ' + 5000 * "9" + "}", "is no JSON"),
    "a list": ("[]", "no model of gpmodel"),
}


@pytest.mark.parametrize("case", WHOLE)
def test_what_is_no_model_is_refused(case: str, tmp_path: Path) -> None:
    refused(*WHOLE[case], tmp_path / "model.json")


TURN = np.eye(4)
FIRST, TERM = ("effects", 0), ("effects", 0, "terms", 0)
CHANGES: dict[str, tuple[tuple[str | int, ...], object, str]] = {
    "another kind": (("kind",), "recipe", "no model of gpmodel"),
    "newer": (("schema",), 99, "schema 99"),
    "no tool": (("tool",), ..., "missing required field `tool`"),
    "no effects": (("effects",), ..., "missing required field `effects`"),
    "no tools": (("tool",), {}, "tool: Expected `object` of length >= 1"),
    "not numbers": (("registration", ""), "here", "registration[...]: Expected `array`"),
    "wrong shape": (("tool", ""), [1, 2, 3], "tool[...]: Expected `array` of length 4, got 3"),
    "scaled": (("registration", ""), (2 * TURN).tolist(), "registration['']: no rotation and translation"),
    "mirrored": (("tool", ""), np.diag([1.0, 1, -1, 1]).tolist(), "tool['']: no rotation and translation"),
    "sheared": (("tool", ""), (TURN + 1e-3 * np.eye(4, k=1)).tolist(), "tool['']: no rotation and translation"),
    "a long tool": (("tool", "", 0, 3), 1e4, "10000 m, expected at most 1000 m"),
    "far": (("sigma_m",), 1e300, "sigma_m: Expected `float` <= 10000000000000.0"),
    "negative": (("sigma_m",), -1.0, "sigma_m: Expected `float` >= 0.0"),
    "a truth for a number": (("sigma_m",), True, "sigma_m: Expected `float`, got `bool`"),
    "covariance": (("covariance",), [[1.0]], "covariance: expected"),
    "a negative variance": (("covariance", 2, 2), -1e-12, "variances of zero or more"),
    "a correlation of two": (("covariance", 2, 0), 1.0, "correlations from -1 to 1"),
    "noise of two axes": (("noise_shape",), [[1.0, 0.0], [0.0, 1.0]], "noise_shape: Expected `array` of length 3"),
    "skew noise": (("noise_shape",), (TURN + np.eye(4, k=1))[:3, :3].tolist(), "noise_shape: expected a symmetric"),
    "noise without a variance": (("noise_shape",), np.diag([3.0, 0.0, 0.0]).tolist(), "noise_shape: expected a symm"),
    "range": (("ranges", "J1"), [1.0, -1.0], "ranges['J1']: expected the lower value first"),
    "many effects": (("effects",), [{}] * 3000, "effects: Expected `array` of length <= 2000"),
    "many columns": (("input_units",), {str(k): "m" for k in range(1000)}, "input_units: Expected `object` of length"),
    "an unknown of one word": (("unknowns", 0), "x", "unknowns: 'x', expected what and its axis"),
    "an unknown without an axis": (("unknowns", 0), "tool up", "unknowns: 'tool up', expected what and its axis"),
    "a row that is not there": (("measured", "heldout"), [999], "measured.heldout: expected places below 40"),
    "columns of no joints": (("measured", "columns"), ["a"], "measured.columns: expected the 6 joints"),
    "null value": ((*FIRST, "value"), None, "effects[0].value: Expected `float`, got `null`"),
    "no terms": ((*FIRST, "terms"), [], "effects[0].terms: Expected `array` of length >= 1"),
    "negative deviation": ((*FIRST, "stderr"), -1.0, "effects[0].stderr: Expected `float` >= 0.0"),
    "a name that ends a text": ((*FIRST, "name"), '"""', "effects[0].name: Expected text without quotes"),
    "a name of two lines": ((*FIRST, "name"), "a\nimport os", "effects[0].name: Expected text without quotes"),
    "a unit that ends a comment": ((*FIRST, "unit"), "*/", "effects[0].unit: Expected `str` matching regex"),
    "long name": ((*FIRST, "name"), "x" * 100_000, "effects[0].name: Expected `str` of length <= 1000"),
    "slot": ((*TERM, "slot"), "J9", "slot 'J9' is unknown"),
    "axis": ((*TERM, "axis"), "Q", "axis 'Q' is unknown"),
    "weight": ((*TERM, "weight"), "one", "effects[0].terms[0].weight: Expected `float`, got `str`"),
    "no expression": ((*TERM, "basis"), "a.b", "cannot read 'a.b'"),
    "code": ((*TERM, "basis"), "__import__('os').system('true')", "cannot read"),
    "a long sum": ((*TERM, "basis"), "+".join(["J1"] * 20_000), "basis: Expected `str` of length <= 20000"),
    "many terms": ((*TERM, "basis"), "+".join(["J1"] * 400), "300 nested levels"),
    "a column that is no name": ((*TERM, "basis"), "'x; system(1)'", "has the input 'x; system(1)', expected the name"),
    "minus signs": ((*TERM, "basis"), "-" * 5000 + "1", "expected an expression"),
    "a bomb": ((*TERM, "basis"), "a = J1;" + 17 * "a = a+a*J2;" + "a", "after named parts are inserted"),
    "other robot": (("mechanism", "name"), "irb6400r-2.8", "has changed"),
    "no robot": (("mechanism", "name"), "hal9000", "'hal9000' is unknown"),
    "a path": (("mechanism", "name"), "../cell.urdf", "mechanism.name: Expected `str` matching regex"),
    "a path of Windows": (("mechanism", "name"), "..\\cell.urdf", "mechanism.name: Expected `str` matching regex"),
    "a name with a line end": (("mechanism", "name"), "a\nb", "mechanism.name: Expected"),
    "a file": (("mechanism", "name"), "cell.urdf", "its description is missing"),
    "another file": (("mechanism",), {"name": "cell.so", "description": "<robot/>"}, "a name that ends in .urdf or"),
    "no description": (("mechanism",), {"name": "cell.urdf", "description": "no robot"}, "not well-formed XML"),
    "payload": (("mechanism", "payload_kg"), -1.0, "mechanism.payload_kg: Expected `float` >= 0.0"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_what_no_model_holds_is_refused_by_its_place(
    case: str, content: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.urdf").write_text("<robot/>")
    (*outer, key), value, said = CHANGES[case]
    changed = deepcopy(content)
    part = reduce(getitem, outer, changed)
    if value is ...:
        del part[key]
    else:
        part[key] = part[key] | value if isinstance(value, dict) and value and key == "mechanism" else value
    refused(sealed(changed), said, tmp_path / "model.json")


def test_a_model_that_was_changed_is_refused(content: dict[str, Any], tmp_path: Path) -> None:
    changed = content | {"sigma_m": 2 * content["sigma_m"]}
    refused(json.dumps(changed), "the content was changed after writing", tmp_path / "model.json")
    bare = {k: v for k, v in content.items() if k != SEAL}
    refused(json.dumps(bare), "the content was changed after writing", tmp_path / "model.json")
    (tmp_path / "model.json").write_text(json.dumps(content, indent=7, sort_keys=True))
    load_model(tmp_path / "model.json")


@pytest.mark.long
def test_a_model_of_before_with_its_whole_covariance_is_read(content: dict[str, Any], tmp_path: Path) -> None:
    whole = fitted("load")[0].covariance.values
    path = tmp_path / "model.json"
    path.write_text(sealed(content, schema=2, covariance=whole.tolist()))
    np.testing.assert_allclose(load_model(path).covariance.values, whole, rtol=1e-12)
    refused(sealed(content, covariance=whole.tolist()), "covariance: expected", path)
    refused(sealed(content, schema=2), "covariance: expected", path)


def test_files_that_are_no_model_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_model(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be read"):
        load_model(tmp_path)
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(InputError, match="larger than 64 MB"):
        load_model(tmp_path / "large.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is no JSON"):
        load_model(tmp_path / "bytes.json")


def test_the_report_beside_it_must_tell_of_it(content: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    (tmp_path / "report.json").write_text(json.dumps({"model_sha256": content[SEAL]}))
    load_model(path)
    (tmp_path / "report.json").write_text(json.dumps({"model_sha256": 64 * "0"}))
    refused(json.dumps(content), "does not match report.json in the same folder", path)
    load_model(path.rename(tmp_path / "t.truth.json"))  # as `simulate --out` in the folder of a result writes it


@pytest.mark.parametrize("case", CASES)
def test_what_is_saved_predicts_the_same(case: str, tmp_path: Path) -> None:
    saved, dataset = fitted(case)
    if case == "load":
        saved = replace(saved, noise_shape=np.array([[0.5, 0.1, 0.0], [0.1, 0.5, 0.2], [0.0, 0.2, 2.0]]))
    save_model(tmp_path / "model.json", saved, remark="anything")
    again = load_model(tmp_path / "model.json")
    tips = [
        observe(m.model, prepare(m.mechanism, with_model_labels(m, dataset)), m.theta, m.placement).tip
        for m in (saved, again)
    ]
    np.testing.assert_array_equal(tips[0], tips[1])
    np.testing.assert_array_equal(saved.stderr, again.stderr)
    np.testing.assert_array_equal(saved.covariance.values, again.covariance.values)
    assert (saved.covariance.placement, saved.ranges) == (again.covariance.placement, again.ranges)
    assert [e.name for e in saved.model.effects] == [e.name for e in again.model.effects]
    assert (saved.weights, saved.sigma, saved.pose) == (again.weights, again.sigma, again.pose)
    np.testing.assert_array_equal(saved.noise_shape, again.noise_shape)
    assert saved.input_units == again.input_units
    before, after = saved.measured, again.measured
    assert before is not None
    assert after is not None
    np.testing.assert_array_equal(before.heldout, after.heldout)
    for name in ("q", "position", "rotation", "row", "payload"):
        np.testing.assert_array_equal(getattr(before.dataset, name), getattr(after.dataset, name))
    assert {k: v.tolist() for k, v in before.dataset.extras.items()} == {
        k: v.tolist() for k, v in after.dataset.extras.items()
    }


def test_covariance_is_of_the_parameters() -> None:
    saved, _ = fitted("geometry")
    kept = np.isfinite(saved.stderr)
    first = len(saved.covariance.placement)
    effects = saved.covariance.values[first:, first:]
    np.testing.assert_allclose(np.sqrt(np.diag(effects))[kept], saved.stderr[kept])
    assert (effects[~kept] == 0.0).all()
    assert (np.diag(saved.covariance.values)[:first] > 0.0).all()


def test_a_mechanism_of_a_file_goes_with_the_model(tmp_path: Path) -> None:
    """On another machine, where the file is not, it predicts the same; no path is kept."""
    urdf = tmp_path / "here" / "cell.urdf"
    urdf.parent.mkdir()
    urdf.write_bytes(Path(str(MechanismChoice("ur5").load().bare.source)).read_bytes())  # type: ignore[attr-defined]
    mechanism = MechanismChoice(str(urdf), frame="tool0").load()
    saved = replace(fitted("geometry")[0], model=ErrorModel(mechanism, geometric_effects(mechanism)))
    count = len(saved.model.effects)
    saved = replace(saved, theta=np.full(count, 1e-4), stderr=np.full(count, np.nan), covariance=unfitted(count))
    saved = replace(saved, measured=None)
    save_model(tmp_path / "model.json", saved)
    shutil.rmtree(urdf.parent)
    text = (tmp_path / "model.json").read_text()
    assert str(tmp_path) not in text
    again = load_model(tmp_path / "model.json")
    q = np.linspace(-1.0, 1.0, 12).reshape(2, 6)
    np.testing.assert_array_equal(again.mechanism.transforms(q), mechanism.transforms(q))
    assert again.mechanism.name == mechanism.name
    save_model(tmp_path / "again.json", again)
    assert (tmp_path / "again.json").read_text() == text


def test_an_effect_that_is_not_finite_at_a_pose_is_named() -> None:
    saved, dataset = fitted("geometry")
    first, *rest = saved.model.effects
    for text in ("log(J1 - J1)", "1/(J2 - J2)", "exp(1e6 + J1)"):
        effect = replace(first, name="odd", terms=(Term("J1.moving", "Rz", Expression(text)),))
        odd = replace(saved, model=ErrorModel(saved.mechanism, (effect, *rest)))
        with pytest.raises(InputError, match=r"effect 'odd': .* is infinite or undefined at some poses"):
            predicted_columns(odd, dataset)
        with pytest.raises(InputError, match=r"effect 'odd': .* is infinite or undefined at some poses"):
            compensate(odd, joint_targets(odd, dataset))


def test_tables_must_fit_the_model() -> None:
    saved, dataset = fitted("input")
    data = replace(dataset, extras={}, extra_units={})
    with pytest.raises(InputError, match=r"column 'temperature \[degC\]' is missing"):
        with_model_labels(saved, data)
    with pytest.raises(InputError, match=r"in \[kelvin\].*\[degC\]"):
        with_model_labels(saved, replace(dataset, extra_units={"temperature": "kelvin"}))
    labelled = replace(dataset, labels={"setup": np.full(40, "elsewhere")})
    with pytest.raises(InputError, match="setup 'elsewhere' is unknown"):
        with_model_labels(saved, labelled)


def test_payload_said_at_calibration_is_that_of_prediction() -> None:
    saved, dataset = fitted("geometry")
    loaded = replace(saved, model=replace(saved.model, mechanism=MechanismChoice("irb6400r", payload=25.0).load()))
    assert (with_model_labels(loaded, dataset).payload == 25.0).all()


def test_basis_without_a_text_cannot_be_saved() -> None:
    class Bump:
        inputs = ("J1",)

        def __call__(self, states: States) -> np.ndarray:
            return np.exp(-(states["J1"] ** 2))

        def __str__(self) -> str:
            return "a bump at zero"

    saved, _ = fitted("geometry")
    effect = Effect("bump", (Term("J1.moving", "Rz", Bump()),), "rad")
    with pytest.raises(InputError, match=r"a bump at zero.*invalid syntax"):
        model_text(replace(saved, model=ErrorModel(saved.mechanism, (effect, *saved.model.effects[1:]))))


@pytest.mark.long
def test_a_model_of_several_payloads_asks_for_the_payload() -> None:
    arm = gp.load_mechanism("irb6400r")
    made = gp.simulate(arm, poses=40, inputs={"payload [kg]": "0|60"}, effects=["joint_compliance J3=1e-7"], seed=1)
    bare, table = joint_table(arm, made.table.q), replace(made.table, in_order=True)
    stop = gp.effect_at("hysteresis", "J2.moving", "Ry", gp.Expression("stop_torque_J2_40"))
    for effects in [], ["joint_compliance J3"], [stop]:
        model = gp.calibrate(arm, table, effects=effects, holdout=0.0).model
        if effects:
            with pytest.raises(InputError, match=r"'payload \[kg\]' is missing; the model needs"):
                model.predict(bare)
        else:
            assert len(model.predict(bare)) == 40
