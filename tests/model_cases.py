"""Calibrations of a robot that are saved and read back."""

from typing import Any

import numpy as np
from cli_cases import robot

from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
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
