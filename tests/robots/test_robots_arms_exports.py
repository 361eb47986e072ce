"""Test exports of a fit of two arms, read back and compared with predictions."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from torso_cases import TIPS, torso

import gpmodel as gp
from gpmodel.api.model import Model
from gpmodel.application.exports.forward import forward_of
from gpmodel.application.exports.make import Exports, exports_of
from gpmodel.application.exports.make import tested as compiled
from gpmodel.application.exports.sample import Place
from gpmodel.calibration.undeclared import SMOOTH
from gpmodel.errors import InputError
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel
from gpmodel.numerics import se3
from gpmodel.table.of_programs import calibrated_urdf

pytestmark = pytest.mark.long

TOLERANCE, MICROMETRE = 1e-9, 1e-6
"""Metres: rounding of what is written with all digits, and of tool points with four of a millimetre."""


YIELDING = ("joint_compliance left_1", "joint_compliance right_1")


def fitted(folder: Path, effects: tuple[str, ...]) -> Model:
    """Zeros of one arm, and effects of 20 µrad/Nm."""
    path = folder / "torso.urdf"
    path.write_text(torso(weighty=True))
    arms = gp.load_mechanism(str(path), frame=TIPS)
    planted = [f"{name}=2e-5 rad/Nm" for name in effects]
    made = gp.simulate(arms, planted, poses=64, instrument="points", noise="0.01 mm", geometry_sigma="0.1 mm")
    return gp.calibrate(arms, made.table, effects, standard=("right_* R?", "left_3 T?"), holdout=0).model


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """A joint of each arm yields."""
    return fitted(tmp_path_factory.mktemp("yielding"), YIELDING)


@pytest.fixture(scope="module", params=["left_tool", "right_tool"])
def of_one_arm(request: pytest.FixtureRequest, model: Model) -> tuple[str, Exports]:
    return request.param, exports_of(model.saved, Place.of(model.saved, tool=request.param))


def points(model: Model, tip: str, q: np.ndarray) -> np.ndarray:
    """Predict the points (N, 3), m, of the tool on one arm."""
    poses = pd.DataFrame(q, columns=[f"{joint.name} [rad]" for joint in model.mechanism.joints])
    return model.predict(poses.assign(tip=tip, tool=tip))[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3


def test_the_source_of_an_arm_is_predict_of_its_tool(model: Model, of_one_arm: tuple[str, Exports]) -> None:
    tip, exports = of_one_arm
    texts = {e.file: e.text for e in exports.files}
    space: dict[str, object] = {}
    exec(texts["exports/model.py"], space)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 11))
    np.testing.assert_allclose(space["predict"](q), points(model, tip, q), atol=TOLERANCE)  # type: ignore[operator]
    assert f"Tool {tip}, one of left_tool, right_tool." in texts["exports/model.c"]


def test_the_c_source_of_an_arm_runs_and_undoes_its_errors(of_one_arm: tuple[str, Exports]) -> None:
    found = compiled(next(e.text for e in of_one_arm[1].files if e.file == "exports/model.c"))
    assert found["largest"] < TOLERANCE
    assert found["miss"] < 2e-9


def test_offsets_of_two_arms_lead_to_what_predict_gives(tmp_path: Path) -> None:
    stiff = fitted(tmp_path, ())
    theta = np.where([e.name == SMOOTH for e in stiff.saved.model.effects], 0.0, stiff.saved.theta)
    stiff = Model(replace(stiff.saved, theta=theta))  # without functions of undeclared effects, which no offset holds
    exports = exports_of(stiff.saved, Place.of(stiff.saved))
    offsets = next(e for e in exports.files if e.file == "exports/joint_offsets.yaml")
    assert offsets.largest < TOLERANCE
    (tmp_path / "offsets.yaml").write_text(offsets.text)
    frames = stiff.mechanism.bare.write_urdf(tmp_path / "nominal.urdf", {})
    text = calibrated_urdf(tmp_path / "offsets.yaml", tmp_path / "nominal.urdf").content
    (tmp_path / "again.urdf").write_text(str(text))
    again = gp.load_mechanism(str(tmp_path / "again.urdf"), frame=frames)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 11))
    found = se3.chain(again.transforms(q))
    for tip, slot in again.bare.tips.items():
        said = re.findall(rf"# Tool point {tip} in {tip}, mm: (.*)\.\n", offsets.text)[0]
        at = np.append([float(v) / 1e3 for v in said.split(",")], 1.0)
        reached = (found[again.slots.index(slot)] @ at)[:, :3]
        assert np.abs(reached - points(stiff, tip, q)).max() < MICROMETRE


def test_what_an_export_of_two_arms_cannot_be_is_one_line(model: Model, of_one_arm: tuple[str, Exports]) -> None:
    refused = of_one_arm[1].refused
    assert refused["exports/ur_kinematics.yaml"] == "torso has several arms; expected one, as in ur_description"
    assert refused["exports/robodk.csv"] == "torso has several arms; expected a serial chain"
    with pytest.raises(InputError, match="no tool belongs to a single arm of torso"):
        forward_of(model.saved, Place("", "left_tool"))


def test_an_arm_that_yields_to_the_load_of_the_other_cannot_be_written(model: Model) -> None:
    load = Effect("load", (Term("left_3.moving", "Ry", gp.Expression("torque_right_1")),), "rad")
    saved = model.saved
    effects, theta = (load, *saved.model.effects[1:]), np.append(1e-3, saved.theta[1:])
    known = replace(saved, model=ErrorModel(model.mechanism, effects), theta=theta)
    with pytest.raises(InputError, match="'torque_right_1' is a load of another arm than tool; expected a load of"):
        forward_of(known, Place.of(known))
