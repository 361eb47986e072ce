"""Warnings about a table that is fit for calibration but has a doubtful property."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration, problem_at, resolved
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Poses, measured_minus, observe, turn_error
from gpmodel.model.states import unused_torques
from gpmodel.numerics.least_squares import outlier_limit, root_mean_square
from gpmodel.numerics.rank import orthonormal, remove
from gpmodel.table.blocks import SAME_JOINT, original, repeat_blocks, replicates
from gpmodel.table.dataset import TOUCHED, Dataset
from gpmodel.wording import left_out, some

JUMP_STATISTIC = 2.3
"""Threshold of the largest standardised cumulative sum of residuals; one of 10⁴ tables exceeds it by chance."""

JUMP_ROWS = 20
"""Least number of rows for a test of the order of the rows."""

SERIAL_SIGMAS = 4.0
"""Threshold of the correlation of neighbouring rows, in standard deviations; one of 3·10⁴ good tables exceeds it."""


PLACED = {"setup": "registration", "tool": "tool point"}
"""Name of the fitted quantity (registration or tool) for each label column."""


def order_matters(fit: Calibration, poses: Poses) -> Iterator[str]:
    """Yield a sentence if residuals jump or drift along the rows, or else if neighbouring rows are correlated.

    Residuals of positions are tested in the axes of the instrument and in the axes of the tool, because either can
    move.
    """
    observed = observe(fit.model, resolved(fit, poses), fit.theta, fit.placement)
    left = measured_minus(observed, poses.dataset) * observed.scales(fit.weights)
    left[fit.outliers] = np.nan
    residual = left[:, ~observed.turns][:, np.isfinite(left[:, ~observed.turns]).any(axis=0)]
    if poses.dataset.observations:
        poses, residual = _view_by_view(poses, residual)
        jump = _jump(residual, poses, residual[:, :0])
    else:
        jump = _jump(residual, poses, np.einsum("nji,nj->ni", observed.tip[:, :3, :3], left[:, :3]))
    if jump is not None:
        yield jump
    elif (serial := _serial(residual, poses)) is not None:
        yield serial


def _view_by_view(poses: Poses, residual: Array) -> tuple[Poses, Array]:
    """Average the residuals of consecutive rows of one pose, since corners of one image are not independent."""
    run = np.cumsum(np.append(0, (np.diff(poses.dataset.q, axis=0) != 0).any(axis=1)))
    known = np.isfinite(residual)
    sums, counts = np.zeros((2, run[-1] + 1, residual.shape[1]))
    np.add.at(sums, run, np.where(known, residual, 0.0))
    np.add.at(counts, run, known)
    first = np.unique(run, return_index=True)[1]
    return poses.subset(first), np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _jump(residual: Array, poses: Poses, at_tool: Array) -> str | None:
    """Describe a jump of residuals along the rows, found by cumulative sums (Ploberger and Krämer 1992), or return
    None.

    residual: (poses, components), m or rad. at_tool: residual of positions in the axes of the tool, m, (poses, 3).
    """
    best: tuple[float, int, float, str] | None = None
    columns = [*((values, "setup") for values in residual.T), *((values, "tool") for values in at_tool.T)]
    for values, label in columns:
        use = np.isfinite(values)
        rows, series = poses.dataset.row[use], values[use]
        if len(series) < JUMP_ROWS:
            continue
        walk = _walk(series)
        at = int(np.argmax(walk[:-1]))
        if best is None or walk[at] > best[0]:
            best = (float(walk[at]), int(rows[at]), float(series[at + 1 :].mean() - series[: at + 1].mean()), label)
    if best is None or best[0] <= JUMP_STATISTIC:
        return None
    joints = zip(poses.dataset.joints, poses.dataset.q.T, strict=True)
    ordered = [name for name, q in joints if np.ptp(q) > SAME_JOINT and _walk(q).max() > JUMP_STATISTIC]
    driven = f", or an effect of {', '.join(ordered)}, whose values change along the rows" if ordered else ""
    return (
        f"residuals change along the rows, most clearly after row {best[1]} (by {1e3 * abs(best[2]):.3g} mm); "
        f"the cause is drift, or a change of the set-up (a column '{best[3]}' gives each part a separate "
        f"{PLACED[best[3]]}){driven}"
    )


def _walk(series: Array) -> Array:
    """Return the absolute standardised cumulative sums of a series."""
    return np.asarray(np.abs(np.cumsum(series - series.mean())) / (series.std() * np.sqrt(len(series)) or 1.0))


def _serial(residual: Array, poses: Poses) -> str | None:
    """Describe the correlation ρ of neighbouring rows that are no repeats, or return None if it is not significant.

    The standard error of ρ is 1 / √pairs, the Durbin-Watson statistic 2 - 2 ρ. Source: Durbin and Watson (1950).
    """
    code = repeat_blocks(poses.dataset)
    apart = code[1:] != code[:-1]
    scaled = residual - np.nanmean(residual, axis=0) if len(residual) >= JUMP_ROWS else residual[:0]
    products = (scaled[1:] * scaled[:-1])[apart] if len(scaled) else scaled
    pairs = int(np.isfinite(products).sum())
    if pairs < JUMP_ROWS:
        return None
    correlation = float(np.nanmean(products) / np.nanmean(scaled**2))
    if correlation * np.sqrt(pairs) <= SERIAL_SIGMAS:
        return None
    return (
        f"residuals of neighbouring rows are alike (correlation {correlation:.2f}, Durbin-Watson "
        f"{2 - 2 * correlation:.2f}): the cause is drift, or neighbouring rows have similar poses"
    )


SMALL_RANGE = np.radians(20.0)
"""Range of a joint, rad, below which a sine of its angle is nearly a straight line."""

POOR = 2e-3
"""Residual of the standard model, m, above which its fit is called poor. A usual residual is 0.1 to 1 mm."""

POOR_TURN = 1e-2
"""Residual of the standard model in the orientations, rad, from which the fit is poor: ten times the residual of a
calibrated machine."""

HOTTEST = 150.0
"""Largest plausible temperature, degC. The temperature of a workshop in kelvin is 290 to 310."""

BUILT_WRONG = 1e-2
"""Deviation, m or rad, from which the description is wrong: links are machined and joint zeros set more accurately."""

RESOLVED = 1e3
"""Condition number up to which errors are divided among equivalent geometric parameters. The relative rounding error is
1e-12; a wrong length has a tenth of the effect of the best determined direction."""

SURE = 5.0
"""Number of standard errors from zero from which a geometric parameter is called wrong."""

FEWEST_REPEATS = 5
"""Least number of repeats of a pose to estimate their spread."""


def warnings_of(mechanism: Mechanism, poses: Poses, fit: Calibration) -> Iterator[str]:
    """Yield one sentence for each warning on a table: on unused loads, joints that hardly move, repeats, outliers,
    order of the rows.

    fit: fit of the standard model.
    """
    data = poses.dataset
    yield from _unmeasured(data)
    yield from _too_hot(data)
    yield from _turned(fit, poses)
    yield from unused_torques(mechanism, data)
    yield from _small_ranges(mechanism, data)
    yield from _repeats(data)
    yield from _implausible_repeats(data)
    yield from _frozen(data)
    yield from _outliers(fit, poses)
    yield from order_matters(fit, poses)
    if fit.status != "converged":
        yield f"the standard model's fit {fit.status}: {fit.reason}"


def poor_fit(fit: Calibration, called: str = "the standard model") -> Iterator[str]:
    """Yield the possible causes of a large residual: table, instrument, or low stiffness. called: name of the model."""
    left = root_mean_square(fit.fitted_error)
    if left > POOR:
        touched = [name for name in TOUCHED if any(key.startswith(f"{name} ") for key in fit.placement.anchors)]
        wrong = f"a wrong label or length ({', '.join(touched)})" if touched else "a wrong column"
        if any(key.startswith("board ") for key in fit.placement.anchors):
            wrong += ", another pitch or size of the board"
        yield (
            f"residual of {called}: {1e3 * left:.3g} mm RMS; calibrated machines have less than {1e3 * POOR:g} "
            f"mm. Possible causes: {wrong}, rows of different poses, a coarse instrument, compliance of joints and base"
        )


def _unmeasured(data: Dataset) -> Iterator[str]:
    """Yield a warning for a coordinate (x, y or z) without any value, if other coordinates have values."""
    missing = [axis for k, axis in enumerate("xyz") if not np.isfinite(data.position[:, k]).any()]
    if 0 < len(missing) < 3:
        one = len(missing) == 1
        yield (
            f"{' and '.join(missing)} {'is' if one else 'are'} not measured in any row: errors along "
            f"{'this axis' if one else 'these axes'} can be neither fitted nor tested"
        )


def _too_hot(data: Dataset) -> Iterator[str]:
    """Yield a warning for temperatures in degC that look like kelvin."""
    for name, unit in data.extra_units.items():
        if unit == "degC" and (typical := float(np.nanmedian(data.extras[name]))) > HOTTEST:
            yield f"column '{name}': {typical:.4g} degC looks like kelvin; expected degC, or the unit [K]"


def _turned(fit: Calibration, poses: Poses) -> Iterator[str]:
    """Yield a warning for a large residual of the standard model in the orientations."""
    if (left := orientation_left(fit, poses)) > POOR_TURN:
        yield (
            f"residual of the orientations: {1e3 * left:.3g} mrad RMS; calibrated machines have less "
            f"than {1e3 * POOR_TURN:g} mrad. Possible causes: a tool that rotated in its holder, or another "
            "convention of rotations"
        )


def orientation_left(fit: Calibration, poses: Poses) -> float:
    """Return the RMS orientation residual of a fit, rad, without outliers; NaN without measured orientations."""
    seen = resolved(fit, poses)
    angles = np.delete(turn_error(observe(fit.model, seen, fit.theta, fit.placement), seen.dataset), fit.outliers)
    measured = angles[np.isfinite(angles)]
    return root_mean_square(measured) if len(measured) else np.nan


def built_wrong(fit: Calibration, poses: Poses) -> Iterator[str]:
    """Yield one sentence for each geometric parameter that is farther from the description than any machine is built.

    Of equivalent parameters, a calibration holds some at zero, and the other parameters absorb the errors. With two
    parallel joints 0.1 m apart, an error of 1 mm becomes an error of 10 mrad. Parameters are therefore tested at those
    equivalent values that have the least sum of squares, in mm and mrad.
    """
    solved = _least(fit, poses)
    values = solved @ fit.theta
    spread = solved * np.nan_to_num(fit.stderr)
    deviations = np.sqrt(np.einsum("ij,jk,ik->i", spread, np.nan_to_num(fit.correlation), spread).clip(0.0))
    for effect, value, sigma in zip(fit.model.effects, values.tolist(), deviations.tolist(), strict=True):
        if abs(value) > BUILT_WRONG and abs(value) > SURE * sigma:
            unit = "mm" if effect.unit == "m" else "mrad"
            yield (
                f"{effect.name} deviates by {1e3 * value:.4g} ± {1e3 * sigma:.2g} {unit} from the description of "
                f"{fit.model.mechanism.name}; expected less than 10: another machine, or a wrong length or zero in its "
                "description"
            )


def _least(fit: Calibration, poses: Poses) -> Array:
    """Return the matrix that maps fitted parameters to the parameters of least norm with equal effect on all points.

    Two series of points count as equal if another registration and tool point map one onto the other. Parameter
    combinations with less than a thousandth of the largest effect are held at zero.
    """
    problem = problem_at(fit, poses)
    placed, effects = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    own = remove(orthonormal(placed), effects)
    return np.asarray(np.linalg.pinv(own, rcond=1.0 / RESOLVED) @ own)


def _implausible_repeats(data: Dataset) -> Iterator[str]:
    """Yield a warning for repeated measurements that are far from the other repeats of the pose."""
    code = replicates(data)
    measured = np.isfinite(data.position).all(axis=1)
    away = np.zeros(len(data))
    for pose in np.flatnonzero(np.bincount(code) > 1):
        rows = np.flatnonzero((code == pose) & measured)
        if len(rows) > 1:
            away[rows] = np.linalg.norm(data.position[rows] - np.median(data.position[rows], axis=0), axis=1)
    again = away > 0
    if again.sum() < FEWEST_REPEATS:
        return
    far = away > outlier_limit(away[again])
    if far.any():
        yield (
            f"rows {some(data.row[far].tolist())} repeat a pose, but differ by up to {1e3 * away.max():.3g} mm "
            "from the "
            f"other repeats; {1e3 * np.median(away[again]):.3g} mm is usual"
        )


def _small_ranges(mechanism: Mechanism, data: Dataset) -> Iterator[str]:
    for i, joint in enumerate(mechanism.joints):
        span = float(np.ptp(data.q[:, i]))
        if span <= SAME_JOINT:
            yield f"{joint.name} does not move; errors of {joint.name} and of its neighbours cannot be separated"
        elif joint.kind == "revolute" and span < SMALL_RANGE:
            yield (
                f"{joint.name} moves only {np.degrees(span):.3g} deg; effects that depend on {joint.name} "
                "cannot be separated from constants"
            )


def _repeats(data: Dataset) -> Iterator[str]:
    first = original(data)
    copied = np.flatnonzero(first < np.arange(len(data)))
    if len(copied):
        pairs = [f"{data.row[first[k]]} and {data.row[k]}" for k in copied]
        yield f"rows {some(pairs)} contain a measurement twice; copies are left out of every fit"


FROZEN = 3
"""Least number of poses with an identical position that indicates a lost target. Two measured positions with few digits
may agree by chance."""


def _frozen(data: Dataset) -> Iterator[str]:
    """Name measured positions that are identical, to the last digit, at several poses."""
    known = np.flatnonzero(np.isfinite(data.position).all(axis=1))
    places, code = np.unique(data.position[known], axis=0, return_inverse=True)
    for k in np.flatnonzero(np.bincount(code.reshape(-1), minlength=len(places)) >= FROZEN):
        rows = known[code.reshape(-1) == k]
        if (np.ptp(data.q[rows], axis=0) > SAME_JOINT).any():
            at = ", ".join(f"{1e3 * v:.6g}" for v in places[k])
            yield (
                f"rows {some(data.row[rows].tolist())} have one position, {at} mm, at different joint values: the "
                "target was lost; expected empty cells there"
            )


def _outliers(fit: Calibration, poses: Poses) -> Iterator[str]:
    """State the excluded measurements, and measurements of one pose whose tools or tips seem exchanged."""
    data = poses.dataset
    if len(fit.outliers):
        worst = 1e3 * fit.error[fit.outliers].max()
        usual = 1e3 * np.median(fit.fitted_error)
        cause = "the cause is a measurement error or an effect that this model lacks"
        if rows := _exchanged(fit, poses):
            cause = f"the tools or tips of rows {some(data.row[rows].tolist())} look exchanged within their poses"
        yield (
            f"{left_out(data.row[fit.outliers].tolist(), len(data))}: errors up to {worst:.3g} mm; {usual:.3g} mm is "
            f"usual with the standard model; {cause}"
        )


def _exchanged(fit: Calibration, poses: Poses) -> list[int]:
    """Return excluded rows whose positions fit another excluded row of their pose, with another tool or tip, and vice
    versa."""
    data = poses.dataset
    expected = observe(fit.model, resolved(fit, poses), fit.theta, fit.placement).tip[:, :3, 3]
    pose, largest = replicates(data, whatever=True), max(fit.fitted_error.max(), POOR)
    carried = np.column_stack([data.codes("tool")[1], data.codes("tip")[1]])
    pairs = [
        (i, k)
        for i, k in combinations(fit.outliers.tolist(), 2)
        if pose[i] == pose[k]
        and (carried[i] != carried[k]).any()
        and max(np.linalg.norm(data.position[[k, i]] - expected[[i, k]], axis=1)) < min(largest, *fit.error[[i, k]])
    ]
    return sorted({row for pair in pairs for row in pair})
