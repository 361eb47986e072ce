"""A lens that is not the image's: a portrait image, a crop, another camera."""

from collections.abc import Mapping
from typing import Any

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.weigh import weighed
from gpmodel.checks.warnings import POOR
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset


def another_centre(model: ErrorModel, data: Dataset) -> str | None:
    """Name the cameras whose principal point, solved with the rest, brings a model below POOR."""
    described: Mapping[str, Any] = data.described.get("cameras", {})
    cameras: Mapping[str, Mapping[str, Any]] = described.get("camera", {})
    stated = {name: c for name, c in cameras.items() if "centre_px" in c and not c.get("solve")}
    if not stated:
        return None
    solved = {**described, "camera": {**cameras, **{n: {**c, "solve": ["centre"]} for n, c in stated.items()}}}
    poses = prepare(model.mechanism, with_observations(data, model.mechanism, {**data.described, "cameras": solved}))
    fit = calibrate(model, weighed(model.mechanism, poses))
    if (left := root_mean_square(fit.fitted_error)) > POOR:
        return None
    found = [(name, fit.placement.anchors[f"lens {name}"], c["centre_px"]) for name, c in stated.items()]
    said = [f"camera {n} has {x[0]:.0f}, {x[1]:.0f} px, described as {c[0]:.0f}, {c[1]:.0f}" for n, x, c in found]
    return (
        f"centre_px is wrong, as of a turned or cut image: {'; '.join(said)}; with it the standard model leaves "
        f"{1e3 * left:.3g} mm RMS"
    )
