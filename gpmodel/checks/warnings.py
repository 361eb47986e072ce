"""What is odd about a table that can be fitted all the same."""

from collections.abc import Iterator, Sequence

import numpy as np

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.checks.counting import SAME_POSE, distinct_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, measured_minus, observe
from gpmodel.model.measured_torque import unused_torques
from gpmodel.table.bundles import noise_floor
from gpmodel.table.dataset import Dataset

SMALL_RANGE = np.radians(20.0)
JUMP_STATISTIC = 2.3
JUMP_ROWS = 20
COARSE_ROTATION = 0.1


def oddities(mechanism: Mechanism, poses: Poses, standard: tuple[Effect, ...]) -> Iterator[str]:
    """One sentence each: rotations that do not fit, joints that hardly move, rows that repeat others, and, with the
    standard model fitted, outliers, jumps along the rows and a fit that does not settle."""
    data = poses.dataset
    yield from unused_torques(mechanism, data)
    yield from _rotations(mechanism, poses)
    yield from _small_ranges(mechanism, data)
    yield from _repeats(data)
    fit = calibrate(ErrorModel(mechanism, standard), poses)
    yield from _outliers(fit, data)
    yield from _jumps(fit, poses)
    if fit.status != "converged":
        yield f"the standard model's fit {fit.status}: {fit.reason}"


def noise_note(data: Dataset) -> str:
    """The noise floor in words."""
    floor = noise_floor(data)
    return "no repeated poses: the noise floor is unknown" if floor is None else f"noise floor {1e3 * floor:.4f} mm RMS"


def _rotations(mechanism: Mechanism, poses: Poses) -> Iterator[str]:
    if not poses.dataset.has_rotation:
        return
    fit = calibrate(ErrorModel(mechanism, ()), poses)
    turn = _rotation_error(fit, poses)
    if turn > COARSE_ROTATION:
        yield (
            f"rx, ry, rz miss the mechanism's rotations by {np.degrees(turn):.3g} deg; expected rotation vectors "
            f"(axis times angle) in the axes of x, y, z"
        )


def _rotation_error(fit: Calibration, poses: Poses) -> float:
    """Median angle, rad, between measured and predicted rotations."""
    residual = measured_minus(observe(fit.model, resolved(fit, poses), fit.theta, fit.placement), poses.dataset)[:, 3:6]
    return float(np.nanmedian(np.linalg.norm(residual, axis=1)))


def _small_ranges(mechanism: Mechanism, data: Dataset) -> Iterator[str]:
    for i, joint in enumerate(mechanism.joints):
        span = float(np.ptp(data.q[:, i]))
        if span < SAME_POSE:
            yield f"{joint.name} does not move; errors of it and of its neighbours cannot be told apart"
        elif joint.kind == "revolute" and span < SMALL_RANGE:
            yield f"{joint.name} moves only {np.degrees(span):.3g} deg; effects that depend on it look like constants"


def _repeats(data: Dataset) -> Iterator[str]:
    _, pose = distinct_poses(data)
    labelled = (data.label("repeat") != "").any()
    measured = np.column_stack([data.position, data.rotation, *data.distances.values()])
    copies: list[str] = []
    repeats: list[str] = []
    for index in np.flatnonzero(np.bincount(pose) > 1):
        rows = np.flatnonzero(pose == index)
        same = np.array_equal(measured[rows[0]], measured[rows[1]], equal_nan=True)
        (copies if same else repeats).append(f"{data.row[rows[0]]} and {data.row[rows[1]]}")
    if copies:
        yield f"rows {_some(copies)} hold the same measurement twice; copied rows make errors look smaller"
    if repeats and not labelled:
        yield f"rows {_some(repeats)} repeat a pose; a column 'repeat' would make them the noise floor"


def _some(items: Sequence[object], most: int = 8) -> str:
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(map(str, items[:most])) + more


def _outliers(fit: Calibration, data: Dataset) -> Iterator[str]:
    if len(fit.outliers):
        worst = 1e3 * fit.error[fit.outliers].max()
        usual = 1e3 * np.median(fit.error)
        yield (
            f"rows {_some(data.row[fit.outliers].tolist())} are outliers: up to {worst:.3g} mm off where "
            f"{usual:.3g} mm is usual with complete geometry; they will not be fitted"
        )


def _jumps(fit: Calibration, poses: Poses) -> Iterator[str]:
    """Largest standardised cumulative sum of the residuals along the rows, per component (Ploberger, Krämer 1992)."""
    data = poses.dataset
    residual = measured_minus(observe(fit.model, resolved(fit, poses), fit.theta, fit.placement), data)
    best: tuple[float, int, float] | None = None
    for values in residual[:, [0, 1, 2, *range(6, residual.shape[1])]].T:
        use = np.isfinite(values) & ~np.isin(np.arange(len(data)), fit.outliers)
        rows, series = data.row[use], values[use]
        if len(series) < JUMP_ROWS:
            continue
        series = series - series.mean()
        walk = np.abs(np.cumsum(series)) / (series.std() * np.sqrt(len(series)) or 1.0)
        at = int(np.argmax(walk[:-1]))
        if best is None or walk[at] > best[0]:
            best = (float(walk[at]), int(rows[at]), float(series[at + 1 :].mean() - series[: at + 1].mean()))
    if best and best[0] > JUMP_STATISTIC:
        yield (
            f"residuals change along the rows, most clearly after row {best[1]} (by {1e3 * abs(best[2]):.3g} mm); "
            f"drift, or something moved: a column 'setup' would fit each part its own registration"
        )
