"""Calibrations of a robot that are saved and read again."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_cases import robot

from gpmodel.application.model_file import SavedModel, load_model, saved_model
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.dataset import Dataset
from gpmodel.texts import SEAL, seal

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


def sealed(content: dict[str, Any], **changes: object) -> str:
    """A file that somebody made on purpose: its seal is whole. Fields that are `...` are left away."""
    made = {k: v for k, v in (content | changes).items() if v is not ...}
    return json.dumps(made | {SEAL: seal(made)})


def refused(text: str, said: str, path: Path) -> None:
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_model(path)
    line = str(caught.value)
    assert said in line
    assert line.startswith(str(path))
    assert "\n" not in line
    assert len(line) < 1000
