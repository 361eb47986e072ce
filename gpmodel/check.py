"""Judging a measured table before anything is fitted to it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel import identifiability as ident
from gpmodel.calibration import ROTATION_LEVER, Calibration, calibrate, linearise, resolved
from gpmodel.dataset import Dataset, IntArray
from gpmodel.effect import Effect, geometric_effects
from gpmodel.errors import InputError
from gpmodel.mechanism import Mechanism
from gpmodel.misreading import misreading
from gpmodel.model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.split import noise_floor
from gpmodel.workspace import random_poses

LIMIT_TOLERANCE = 1e-3
SAME_POSE = 1e-6
SMALL_RANGE = np.radians(20.0)
JUMP_STATISTIC = 2.3
RANK_POSES = 60
RANK_LIMIT = 1e4
COARSE_ROTATION = 0.1


@dataclass(frozen=True)
class Finding:
    """One thing about a table. severity: "error" (nothing may be fitted to it), "warning" or "note"."""

    severity: str
    text: str


def check_dataset(mechanism: Mechanism, poses: Poses, standard: tuple[Effect, ...] | None = None) -> list[Finding]:
    """What is wrong or odd with `poses`, errors first.

    standard: the geometric effects that would be fitted (default: all). Errors: joint values beyond limits, units
    or columns mixed up, poses all alike, fewer measured values than unknowns. Warnings: outliers, jumps along the
    rows, joints that hardly move, rows that repeat others, rotations that do not fit. Notes: the noise floor.
    """
    standard = geometric_effects(mechanism) if standard is None else standard
    data = poses.dataset
    errors = [Finding("error", text) for text in _errors(mechanism, poses, standard)]
    if errors:
        return errors
    warnings = [*_rotations(mechanism, poses), *_small_ranges(mechanism, data), *_repeats(data)]
    fit = calibrate(ErrorModel(mechanism, standard), poses)
    warnings += [*_outliers(fit, data), *_jumps(fit, poses), *_unsettled(fit)]
    return [Finding("warning", text) for text in warnings] + [Finding("note", text) for text in _notes(data)]


def refuse(mechanism: Mechanism, poses: Poses, standard: tuple[Effect, ...] | None = None) -> None:
    """Raises InputError with the first error check_dataset would find."""
    standard = geometric_effects(mechanism) if standard is None else standard
    for text in _errors(mechanism, poses, standard):
        raise InputError(text)


def _errors(mechanism: Mechanism, poses: Poses, standard: tuple[Effect, ...]) -> Iterator[str]:
    """Reasons not to go on, each found only where those before it are not."""
    data = poses.dataset
    beyond = list(_beyond_limits(mechanism, data))
    if alike := _all_alike(data):
        yield alike
        return
    if mixed := misreading(mechanism, data):
        yield f"{data.source}: {mixed}"
        return
    if beyond:
        yield from beyond
        return
    yield from _too_few(mechanism, data, standard)


def _beyond_limits(mechanism: Mechanism, data: Dataset) -> Iterator[str]:
    for i, joint in enumerate(mechanism.joints):
        values = data.q[:, i]
        bad = (values < joint.lower - LIMIT_TOLERANCE) | (values > joint.upper + LIMIT_TOLERANCE)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            more = f" and {int(bad.sum()) - 1} more rows" if bad.sum() > 1 else ""
            lower, upper = (_shown(joint.kind, limit) for limit in (joint.lower, joint.upper))
            yield (
                f"{data.source}, column '{joint.name}', row {data.row[row]}{more}: "
                f"{_shown(joint.kind, values[row])} is beyond its limits; expected {lower} to {upper}"
            )


def _shown(kind: str, value: float) -> str:
    return f"{np.degrees(value):.6g} deg" if kind == "revolute" else f"{1e3 * value:.6g} mm"


def _all_alike(data: Dataset) -> str | None:
    if np.ptp(data.q, axis=0).max() < SAME_POSE:
        count = f"all {len(data)} poses are alike" if len(data) > 1 else "there is only one pose"
        return f"{data.source}: {count}; expected joint values that differ from row to row"
    return None


def _distinct(data: Dataset) -> tuple[IntArray, IntArray]:
    """First row of each distinct pose, and each row's index into them."""
    loads = np.column_stack([data.q, data.payload])
    keys = [np.round(loads / SAME_POSE).astype(np.int64)]
    keys += [data.codes(c)[1][:, None] for c in ("setup", "tool")]
    _, first, inverse = np.unique(np.hstack(keys), axis=0, return_index=True, return_inverse=True)
    return first.astype(np.int64), inverse.reshape(-1).astype(np.int64)


def _too_few(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> Iterator[str]:
    first, _ = _distinct(data)
    distinct = data.subset(np.sort(first))
    values = int(np.isfinite(distinct.position).sum() + np.isfinite(distinct.rotation).sum())
    values += sum(int(np.isfinite(d).sum()) for d in data.distances.values())
    needed = unknowns(mechanism, data, standard)
    if values <= needed:
        yield (
            f"{data.source}: {len(distinct)} distinct poses give {values} measured values for {needed} unknowns; "
            f"expected more poses than that (or fewer parameters, --standard)"
        )


def unknowns(mechanism: Mechanism, data: Dataset, effects: tuple[Effect, ...]) -> int:
    """How many numbers registration, tool, anchors and the constant effects are, counting only combinations that
    well spread poses could tell apart: rank at the nominal geometry over random poses within the limits."""
    many = random_poses(mechanism, RANK_POSES, np.random.default_rng(0))
    position = np.zeros((RANK_POSES, 3)) if np.isfinite(data.position).any() else np.full((RANK_POSES, 3), np.nan)
    rotation = np.zeros((RANK_POSES, 3)) if data.has_rotation else np.full((RANK_POSES, 3), np.nan)
    distances = {name: np.full(RANK_POSES, 1.0 + i) for i, name in enumerate(data.distances)}
    row = np.arange(1, RANK_POSES + 1)
    template = Dataset(data.joints, many, position, rotation, row, np.zeros(RANK_POSES), distances)
    tool = np.eye(4)
    tool[:3, 3] = (0.05, 0.07, 0.11)
    anchors = {name: np.array([2.0, 0.3 + i, 0.1]) for i, name in enumerate(distances)}
    model = ErrorModel(mechanism, tuple(e for e in effects if e.constant))
    placement = Placement({"": np.eye(4)}, {"": tool}, anchors)
    zero, use = np.zeros(len(model.effects)), np.ones(RANK_POSES, dtype=bool)
    problem = linearise(model, prepare(mechanism, template), zero, placement, ROTATION_LEVER, use)
    placed, columns = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    kept = ident.rank(placed, columns).kept(RANK_LIMIT)
    setups, tools = len(data.codes("setup")[0]), len(data.codes("tool")[0])
    absolute = bool(np.isfinite(position).any() or data.has_rotation)
    more = 6 * (setups - 1) * absolute + (6 if data.has_rotation else 3) * (tools - 1)
    return int(ident.orthonormal(placed).shape[1] + len(kept) + more)


def _rotations(mechanism: Mechanism, poses: Poses) -> Iterator[str]:
    if not poses.dataset.has_rotation:
        return
    fit = calibrate(ErrorModel(mechanism, ()), poses)
    turn = fit_rotation_error(fit, poses)
    if turn > COARSE_ROTATION:
        yield (
            f"rx, ry, rz miss the mechanism's rotations by {np.degrees(turn):.3g} deg; expected rotation vectors "
            f"(axis times angle) in the axes of x, y, z"
        )


def fit_rotation_error(fit: Calibration, poses: Poses) -> float:
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
    _, pose = _distinct(data)
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
        if len(series) < 20:
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


def _unsettled(fit: Calibration) -> Iterator[str]:
    if fit.status != "converged":
        yield f"the standard model's fit {fit.status}: {fit.reason}"


def _notes(data: Dataset) -> Iterator[str]:
    floor = noise_floor(data)
    yield "no repeated poses: the noise floor is unknown" if floor is None else f"noise floor {1e3 * floor:.4f} mm RMS"
