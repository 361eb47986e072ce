"""Residuals no larger than the digits a table is written with: computed positions, or readings that were rounded."""

from collections.abc import Iterator

import numpy as np

from gpmodel.arrays import Array
from gpmodel.table.dataset import Dataset

MOST_DIGITS = 9
"""Decimals of a millimetre or a degree after which a number counts as not rounded."""
FINEST = 5e-6
"""Metres, RMS, that no instrument on a robot measures below: what is less is computed."""
SPREAD = 1.0 / np.sqrt(12.0)
"""Standard deviation of a rounding error over the last digit."""
ENOUGH = 1.5
"""Times the rounding that a residual may be which it explains."""


def written_to_a_digit(data: Dataset) -> bool:
    """Return whether all positions (N, 3) end at one decimal, as those written by a controller do."""
    return _last_digits(data)[0] > 0


def computed(left: float, data: Dataset) -> Iterator[str]:
    """A table of a controller's own forward kinematics. left: RMS, m, of registration and tool alone."""
    step = rounding(data)
    if written_to_a_digit(data) and left < min(ENOUGH * step, FINEST):
        yield (
            f"these positions are computed, not measured: registration and tool leave {1e6 * left:.2g} µm, the "
            "rounding of their digits; expected positions of an instrument, not those the controller shows"
        )


def rounded(left: float, data: Dataset) -> Iterator[str]:
    """A residual that is rounding. left: RMS, m, of the standard model."""
    largest, (step, turn) = rounding(data), _last_digits(data)
    if FINEST < left < ENOUGH * largest:
        ends = [f"joint values end at {np.degrees(turn):.3g} deg"] if turn else []
        ends += [f"positions end at {1e3 * step:.3g} mm"] if step else []
        yield (
            f"rounding explains what is left: {' and '.join(ends)}, which makes up to "
            f"{1e3 * largest:.3g} mm RMS; expected more digits"
        )


def rounding(data: Dataset) -> float:
    """RMS distance, m, that rounding of all joint values and positions makes, at most: every joint at full reach."""
    step, turn = _last_digits(data)
    whole = data.position[np.isfinite(data.position).all(axis=1)]
    reach = float(np.sqrt(np.mean(np.sum((whole - whole.mean(axis=0)) ** 2, axis=1)))) if len(whole) else 0.0
    return float(SPREAD * np.hypot(np.sqrt(3.0) * step, np.sqrt(data.q.shape[1]) * turn * reach))


def _last_digits(data: Dataset) -> tuple[float, float]:
    """Last decimal of all positions, m, and of all joint values, rad or m; zero where they do not end alike."""
    return 1e-3 * _last(1e3 * data.position), float(np.radians(_last(np.degrees(data.q))))


def _last(values: Array) -> float:
    known = values[np.isfinite(values)]
    for digits in range(-1, MOST_DIGITS):
        scaled = known * 10.0**digits
        if len(known) and np.abs(scaled - np.round(scaled)).max() < 1e-4:
            return 10.0**-digits
    return 0.0
