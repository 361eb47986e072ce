"""model.json: text that brings the model back."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_cases import robot

from gpmodel.application.matching import matched
from gpmodel.application.model_file import SavedModel, load_model, model_text, save_model, saved_model
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.geometric import geometric_effects
from gpmodel.model.states import States
from gpmodel.table.dataset import Dataset

CASES: dict[str, dict[str, Any]] = {
    "geometry": {},
    "load": {"effects": ("base_compliance=3e-7",)},
    "pair": {"effects": ("gear_harmonic J4=60 arcsec",)},
    "input": {
        "effects": ("thermal_zero J2=5e-6",),
        "inputs": {"temperature": np.linspace(20.0, 30.0, 40)},
        "input_units": {"temperature": "degC"},
    },
    "payload": {"effects": ("joint_compliance J2=1e-7",), "payload": np.linspace(0.0, 60.0, 40)},
}


def fitted(case: str) -> tuple[SavedModel, Dataset]:
    mechanism, made = robot(40, **CASES[case])
    extra = tuple(e for e in made.model.effects if not e.constant)
    poses = prepare(mechanism, made.dataset)
    fit = calibrate(ErrorModel(mechanism, geometric_effects(mechanism) + extra), poses)
    return saved_model(fit, poses), made.dataset


@pytest.mark.parametrize("case", CASES)
def test_what_is_saved_predicts_the_same(case: str, tmp_path: Path) -> None:
    saved, dataset = fitted(case)
    save_model(tmp_path / "model.json", saved, remark="anything")
    again = load_model(tmp_path / "model.json")
    tips = [
        observe(m.model, prepare(m.mechanism, matched(m, dataset)), m.theta, m.placement).tip for m in (saved, again)
    ]
    np.testing.assert_array_equal(tips[0], tips[1])
    np.testing.assert_array_equal(saved.stderr, again.stderr)
    np.testing.assert_array_equal(saved.covariance.values, again.covariance.values)
    assert (saved.covariance.placement, saved.ranges) == (again.covariance.placement, again.ranges)
    assert [e.name for e in saved.model.effects] == [e.name for e in again.model.effects]
    assert (saved.rotation_weight, saved.sigma, saved.pose) == (again.rotation_weight, again.sigma, again.pose)
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


def spoiled(content: dict[str, object], **changes: object) -> str:
    return json.dumps({k: v for k, v in (content | changes).items() if v is not ...})


def test_bad_models_are_refused_in_one_line(tmp_path: Path) -> None:
    saved, _ = fitted("load")
    content = json.loads(model_text(saved))
    effects, about = content["effects"], content["mechanism"]
    cases = {
        "no JSON": ("{", "is no JSON"),
        "too deep": ("[" * 100_000, "is no JSON"),
        "a list": ("[]", "no model of gpmodel"),
        "another kind": (spoiled(content, kind="recipe"), "no model of gpmodel"),
        "newer": (spoiled(content, schema=99), "schema 99"),
        "no tool": (spoiled(content, tool=...), "damaged model"),
        "no effects": (spoiled(content, effects=...), "damaged model"),
        "not numbers": (spoiled(content, registration={"": "here"}), "damaged model"),
        "wrong shape": (spoiled(content, tool={"": [1, 2, 3]}), "damaged model"),
        "null value": (spoiled(content, effects=[{**effects[0], "value": None}, *effects[1:]]), "damaged model"),
        "other robot": (spoiled(content, mechanism={**about, "name": "irb6400r-2.8"}), "has changed"),
        "no robot": (spoiled(content, mechanism={**about, "name": "hal9000"}), "'hal9000' is unknown"),
        "bad slot": (
            spoiled(
                content, effects=[{**effects[0], "terms": [{**effects[0]["terms"][0], "slot": "J9"}]}, *effects[1:]]
            ),
            "slot 'J9' is unknown",
        ),
        "bad basis": (
            spoiled(
                content, effects=[{**effects[0], "terms": [{**effects[0]["terms"][0], "basis": "a.b"}]}, *effects[1:]]
            ),
            "cannot read",
        ),
    }
    path = tmp_path / "model.json"
    for name, (text, said) in cases.items():
        path.write_text(text)
        with pytest.raises(InputError) as caught:
            load_model(path)
        assert said in str(caught.value), name
        assert "model.json" in str(caught.value), name
        assert "\n" not in str(caught.value), name
    with pytest.raises(InputError, match="cannot be read"):
        load_model(tmp_path / "none.json")


def test_tables_must_fit_the_model() -> None:
    saved, dataset = fitted("input")
    data = replace(dataset, extras={}, extra_units={})
    with pytest.raises(InputError, match=r"column 'temperature \[degC\]' is missing"):
        matched(saved, data)
    with pytest.raises(InputError, match=r"in \[kelvin\].*\[degC\]"):
        matched(saved, replace(dataset, extra_units={"temperature": "kelvin"}))
    labelled = replace(dataset, labels={"setup": np.full(40, "elsewhere")})
    with pytest.raises(InputError, match="setup 'elsewhere' is unknown"):
        matched(saved, labelled)


def test_payload_said_at_calibration_is_that_of_prediction() -> None:
    saved, dataset = fitted("geometry")
    loaded = replace(saved, model=replace(saved.model, mechanism=MechanismChoice("irb6400r", payload=25.0).load()))
    assert (matched(loaded, dataset).payload == 25.0).all()


def test_basis_without_a_text_cannot_be_saved() -> None:
    class Bump:
        inputs = ("J1",)

        def __call__(self, states: States) -> np.ndarray:
            return np.exp(-(states["J1"] ** 2))

        def __str__(self) -> str:
            return "a bump at zero"

    saved, _ = fitted("geometry")
    effect = Effect("bump", (Term("J1.moving", "Rz", Bump()),), "rad")
    with pytest.raises(InputError, match="invalid syntax"):
        model_text(replace(saved, model=ErrorModel(saved.mechanism, (effect, *saved.model.effects[1:]))))
