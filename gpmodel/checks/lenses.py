"""Compare the described lenses of the cameras with lenses that are fitted to the images."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.start import start_placements
from gpmodel.errors import InputError
from gpmodel.model import lens
from gpmodel.model.error_model import Poses
from gpmodel.model.pixel import Camera, Pixels

SOLVED = range(8)
"""Positions of the lens parameters that are estimated: focal length, centre, and distortion without k3."""
MAJORITY = 0.5
"""Share of the variance of the pixels above which the lens is the largest cause of their residual."""
SURE = 5.0
"""Number of standard errors from its described value from which a number of a lens is called wrong."""
ADVICE = 'expected solve = ["focal", "centre", "distortion"] in the description of the camera'


def with_fitted_lenses(poses: Poses) -> Poses | None:
    """Return the poses with every lens to be estimated; None if no images were measured or all lenses are estimated.

    The initial focal length comes from the views of a flat board, or else from the description.
    """
    data = poses.dataset
    images = [kind for kind in data.observations if isinstance(kind, Pixels)]
    if not images or all({*SOLVED} <= {*camera.solved} for camera in images[0].cameras):
        return None
    for unknown in (slice(0, 4), slice(0, 0)):
        cameras = []
        for camera in images[0].cameras:
            numbers = camera.lens.copy()
            numbers[unknown] = 0.0
            cameras.append(replace(camera, lens=numbers, solved=tuple(sorted({*camera.solved, *SOLVED}))))
        others = (replace(k, cameras=tuple(cameras)) if isinstance(k, Pixels) else k for k in data.observations)
        solved = replace(poses, dataset=replace(data, observations=tuple(others)))
        with suppress(InputError):
            next(start_placements(solved))
            return solved
    return None


def another_lens(fit: Calibration, poses: Poses) -> str | None:
    """Name the cameras whose described lens causes most of the residual of the images, and the numbers that differ."""
    solved = with_fitted_lenses(poses)
    if solved is None:
        return None
    again = calibrate(fit.model, solved)
    (before,), (after,) = ([k for k in p.dataset.observations if isinstance(k, Pixels)] for p in (poses, solved))
    left, with_lens = fit.noise_of(before), again.noise_of(after)
    if with_lens**2 > (1.0 - MAJORITY) * left**2:
        return None
    found = [f"camera {c.name} has {', '.join(said)}" for c in before.cameras if (said := [*_differences(c, again)])]
    return (
        f"the lens of a camera is not the described one (undeclared distortion, or an image that was rotated or "
        f"cropped): {'; '.join(found)}; residual {left:.3g} px, with fitted lenses {with_lens:.3g} px; {ADVICE}"
    )


def _differences(camera: Camera, fit: Calibration) -> Iterator[str]:
    """Yield every number of a lens that differs from its description, with both values."""
    names = fit.covariance.placement
    values = fit.placement.anchors[f"lens {camera.name}"]
    for name, value in zip(lens.NAMES, values.tolist(), strict=False):
        k = names.index(f"lens {camera.name} {name}")
        sigma, stated = float(np.sqrt(fit.covariance.values[k, k])), float(camera.lens[lens.NAMES.index(name)])
        if abs(value - stated) > SURE * sigma:
            unit = " px" if name in lens.NAMES[:4] else ""
            yield f"{name} {value:.4g} ± {sigma:.1g}{unit}, described as {stated:.4g}"
