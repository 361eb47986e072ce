"""model.json: text that brings the model back."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_cases import CASES, fitted

from gpmodel.application.compensate import compensate, joint_targets
from gpmodel.application.matching import matched
from gpmodel.application.model_file import load_model, model_text, save_model, unfitted
from gpmodel.application.predict import predicted_columns
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import States


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
    with pytest.raises(InputError, match=r"a bump at zero.*invalid syntax"):
        model_text(replace(saved, model=ErrorModel(saved.mechanism, (effect, *saved.model.effects[1:]))))
