"""Tables of instruments that measure no positions, with known true values."""

from dataclasses import replace
from functools import cache

import numpy as np

import gpmodel as gp
from gpmodel.api.simulate import SimulationResult
from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import frame_of
from gpmodel.planning.simulate import INSTRUMENTS
from gpmodel.table.dataset import unmeasured

ARM = "irb6400r"
OTHERS = tuple(name for name in INSTRUMENTS if name != "tracker")
EFFECT = "gear_harmonic J4"


@cache
def simulated(instrument: str, poses: int = 60, noise: float | None = None, effect: str = "") -> SimulationResult:
    """Poses of an arm with geometric errors of 0.3 mm and, perhaps, an effect."""
    return gp.simulate(
        ARM, [effect] if effect else [], poses=poses, instrument=instrument, noise=noise, geometry_sigma="0.3 mm",
    )  # fmt: skip


def ready(made: SimulationResult) -> Poses:
    """Its poses, pixels and degrees weighed."""
    mechanism = made.truth.mechanism
    return prepare(mechanism, made.table)


def tool_error(made: SimulationResult, fit: Calibration) -> Array:
    """Distances (N,), m, of what the fitted model carries from where it truly is at poses nobody measured, in the frame
    that fits best: of the tool point, or of the camera or board in the hand where that is all that was seen."""
    saved, mechanism = made.truth.saved, made.truth.mechanism
    q = random_poses(mechanism, 100, np.random.default_rng(5))
    poses, points = prepare(mechanism, unmeasured(made.table.joints, q)), []
    for model, theta, placement in ((saved.model, saved.theta, saved.placement), (fit.model, fit.theta, fit.placement)):
        tool = placement.tool
        if "camera C" in placement.anchors:
            held = "board B" if made.table.described["board"]["board"]["B"]["link"] == "tool" else "camera C"
            tool = {"": frame_of(placement.anchors[held])}
        tip = observe(model, poses, theta, replace(placement, tool=tool)).tips.root
        points.append(tip[:, :3, 3])
    turn, shift = se3.fit_rotation(points[1], points[0])
    return np.linalg.norm(points[0] - points[1] @ turn.T - shift, axis=1)
