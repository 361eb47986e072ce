"""Models for export, with their points and poses."""

import numpy as np
import pandas as pd
from cli_cases import robot

from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import Model


def fitted(name: str, effects: tuple[str, ...]) -> Model:
    """A model with the effects that were planted; J1 and J2 stand for the joints of ur5 and panda."""
    for arm, number, joint in (("ur5", "J1.", "shoulder_pan_joint."), ("panda", "J2.", "panda_joint2.")):
        effects = tuple(text.replace(number, joint) if name == arm else text for text in effects)
    mechanism, made = robot(80, 3, name, effects=effects)
    return calibrate(mechanism, made.dataset, [text.rpartition("=")[0] for text in effects]).model


def points(model: Model, q: np.ndarray) -> np.ndarray:
    """Predict points, m."""
    frame = pd.DataFrame({f"{j.name} [rad]": v for j, v in zip(model.mechanism.joints, q.T, strict=True)})
    return model.predict(frame)[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3


def fresh(model: Model, count: int = 60) -> np.ndarray:
    low, high = np.array([model.saved.ranges[j.name] for j in model.mechanism.joints]).T
    return np.random.default_rng(9).uniform(low, high, (count, len(low)))
