"""The inverse in C: what compensate gives, pose by pose."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import robot

from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import Model
from gpmodel.application.exports.forward import forward_of
from gpmodel.application.exports.sample import Place
from gpmodel.application.exports.sources import c_text
from gpmodel.mechanism.source import choice_of

EFFECTS = {
    "irb6400r": ("base_compliance=3e-7", "gear_harmonic J4=60 arcsec"),
    "panda": ("J2.moving:Tz:step(x)*abs(y)=0.4 mm",),
}


def calibrated(name: str) -> Model:
    effects = tuple(text.replace("J2.", "panda_joint2.") if name == "panda" else text for text in EFFECTS[name])
    mechanism, made = robot(80, 3, name, effects=effects)
    return calibrate(mechanism, made.dataset, [text.rpartition("=")[0] for text in effects]).model


def points(model: Model, q: np.ndarray) -> np.ndarray:
    """Predict points, m."""
    frame = pd.DataFrame({f"{j.name} [rad]": v for j, v in zip(model.mechanism.joints, q.T, strict=True)})
    return model.predict(frame)[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3


def fresh(model: Model, count: int) -> np.ndarray:
    low, high = np.array([model.saved.ranges[j.name] for j in model.mechanism.joints]).T
    return np.random.default_rng(9).uniform(low, high, (count, len(low)))


@pytest.mark.long
@pytest.mark.parametrize("name", ["irb6400r", "panda"])
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_inverse_in_c_is_that_of_compensate(name: str, tmp_path: Path) -> None:
    model = calibrated(name)
    forward = forward_of(model.saved, Place.of(model.saved))
    (tmp_path / "model.c").write_text(
        c_text(forward, "", np.zeros((1, len(fresh(model, 1)[0]) + len(forward.inputs) + 3)))
    )
    library = tmp_path / "model.so"
    done = subprocess.run(
        ["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", str(tmp_path / "model.c"), "-lm",
         "-o", str(library)], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    inverse = ctypes.CDLL(str(library)).gpmodel_compensate
    q = fresh(model, 200)
    frame = pd.DataFrame({f"{j.name} [rad]": v for j, v in zip(model.mechanism.joints, q.T, strict=True)})
    expected = model.compensate(frame)
    wanted = expected.filter(regex=r"^corrected_").to_numpy(dtype=float)
    wanted = np.radians(wanted) if "[deg]" in "".join(expected.filter(regex="^corrected_").columns) else wanted
    inputs = np.zeros(16)
    for k, given in enumerate(forward.inputs):
        inputs[k] = float(choice_of(model.mechanism).payload or 0.0) if given == "payload" else 0.0
    double = ctypes.POINTER(ctypes.c_double)
    found = np.full_like(q, np.nan)
    for k, row in enumerate(q):
        start, out = np.ascontiguousarray(row), np.empty(q.shape[1])
        if inverse(start.ctypes.data_as(double), inputs.ctypes.data_as(double), out.ctypes.data_as(double)):
            np.testing.assert_array_equal(out, start)
            continue
        found[k] = out
    ok = (expected["status"] == "ok").to_numpy()
    both = ok & np.isfinite(found).all(axis=1)
    assert both.sum() >= 0.95 * ok.sum() > 100
    assert np.linalg.norm(points(model, found[both]) - points(model, wanted[both]), axis=1).max() < 1e-6
