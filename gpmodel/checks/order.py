"""Effect of the order of the rows: jumps and drifts of the residual along them."""

from collections.abc import Iterator

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.model.error_model import Poses, measured_minus, observe
from gpmodel.table.bundles import bundles

JUMP_STATISTIC = 2.3
"""Threshold of the largest standardised cumulative sum: by chance exceeded in less than one of 10⁴ tables."""

JUMP_ROWS = 20
"""Fewer rows show no order."""

SERIAL_SIGMAS = 4.0
"""Standard deviations of the correlation of neighbouring rows: by chance once in 3·10⁴ tables."""


PLACED = {"setup": "registration", "tool": "tool point"}
"""Fitted quantity for each value of a column."""


def order_matters(fit: Calibration, poses: Poses) -> Iterator[str]:
    """One sentence where residuals jump or drift along the rows, else where each row resembles the one before.

    Residuals of positions are taken in the axes of the instrument, which may have moved, and in those of the tool.
    """
    observed = observe(fit.model, resolved(fit, poses), fit.theta, fit.placement)
    left = measured_minus(observed, poses.dataset) * observed.scales(1.0)
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
    """Rows that follow one another in one pose as one, their residuals averaged: corners of one view say one thing."""
    run = np.cumsum(np.append(0, (np.diff(poses.dataset.q, axis=0) != 0).any(axis=1)))
    known = np.isfinite(residual)
    sums, counts = np.zeros((2, run[-1] + 1, residual.shape[1]))
    np.add.at(sums, run, np.where(known, residual, 0.0))
    np.add.at(counts, run, known)
    first = np.unique(run, return_index=True)[1]
    return poses.subset(first), np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def _jump(residual: Array, poses: Poses, at_tool: Array) -> str | None:
    """Largest standardised cumulative sum along the rows, per component. Source: Ploberger and Krämer (1992).

    residual: (N, m). at_tool: (N, 3), that of the positions in the axes of the tool, or (N, 0).
    """
    best: tuple[float, int, float, str] | None = None
    columns = [*((values, "setup") for values in residual.T), *((values, "tool") for values in at_tool.T)]
    for values, label in columns:
        use = np.isfinite(values)
        rows, series = poses.dataset.row[use], values[use]
        if len(series) < JUMP_ROWS:
            continue
        series = series - series.mean()
        walk = np.abs(np.cumsum(series)) / (series.std() * np.sqrt(len(series)) or 1.0)
        at = int(np.argmax(walk[:-1]))
        if best is None or walk[at] > best[0]:
            best = (float(walk[at]), int(rows[at]), float(series[at + 1 :].mean() - series[: at + 1].mean()), label)
    if best is None or best[0] <= JUMP_STATISTIC:
        return None
    return (
        f"residuals change along the rows, most clearly after row {best[1]} (by {1e3 * abs(best[2]):.3g} mm); "
        f"drift, or something moved: a column '{best[3]}' would fit each part its own {PLACED[best[3]]}"
    )


def _serial(residual: Array, poses: Poses) -> str | None:
    """Correlation ρ of neighbouring rows that are no repeats of one another; σ(ρ) = 1 / √pairs, Durbin-Watson 2 - 2 ρ.

    Source: Durbin and Watson (1950).
    """
    code = bundles(poses.dataset)
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
        f"{2 - 2 * correlation:.2f}): the order of the rows matters, by drift or because neighbours are near in space"
    )
