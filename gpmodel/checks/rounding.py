"""Size of the rounding errors of a table; positions that a controller computed; residuals that rounding explains."""

from collections.abc import Iterator

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.observed import Observed
from gpmodel.table.dataset import Dataset

MOST_DIGITS = 9
"""Number of decimals of a millimetre or a degree from which a number counts as not rounded."""
FINEST = 5e-6
"""RMS residual, m, below which positions are computed and not measured: no instrument on a robot is as accurate."""
SPREAD = 1.0 / np.sqrt(12.0)
"""Ratio of the standard deviation of a rounding error to the size of the last digit."""
ENOUGH = 1.5
"""Ratio of a residual to the rounding error, up to which rounding explains the residual."""
SIGMAS = 3.0
"""Standard deviations of an RMS by which a residual of rounding may be too small; one of 740 residuals is smaller."""


def written_to_a_digit(data: Dataset) -> bool:
    """Return whether all positions are rounded to a common decimal, as in files of a robot controller."""
    return last_digits(data)[0] > 0


def computed(left: float, data: Dataset) -> Iterator[str]:
    """Yield an error if a controller computed the positions. left: RMS residual after registration and tool, m."""
    step = rounding(data)
    if written_to_a_digit(data) and left < min(ENOUGH * step, FINEST):
        yield (
            f"these positions are computed, not measured: the residual is {1e6 * left:.2g} µm, the "
            "rounding of the digits; expected positions of an instrument, not of the controller"
        )


def rounded(mechanism: Mechanism, observed: Observed, data: Dataset, left: float, freedom: float) -> Iterator[str]:
    """Yield a sentence if rounding of joint values and positions explains the residual of a fit.

    left: RMS 3-D residual, m, corrected for the fitted unknowns. freedom: degrees of freedom of the residual.

    Expected: e² = mean of Σ_j (d_j² / 12) |∂p/∂q_j|² + 3 s² / 12, last digits d_j and s of joint values and positions.
    Rounding explains a residual from e (less three standard deviations, e / √(2 freedom) each) to 1.5 e. A smaller
    residual shows that the joint values are exact, such as commanded whole degrees.
    """
    step, steps = last_digits(data)
    known = np.isfinite(data.position)
    rows = known.any(axis=1)
    if not rows.any() or left < FINEST:
        return
    drives = np.zeros((len(steps), *known.shape))
    for j, joint in enumerate(mechanism.joints):
        for slot, axis, weight in joint.drive:
            drives[j] += weight * observed.sensitivity(mechanism.slots.index(slot))[:, :3, AXES.index(axis)]
    moved = np.where(known, steps[:, None, None] * drives, 0.0)[:, rows]
    turned = SPREAD * float(np.sqrt(np.sum(moved**2) / rows.sum()))
    written = SPREAD * step * float(np.sqrt(known.sum() / rows.sum()))
    expected = np.hypot(turned, written)
    if expected * (1.0 - SIGMAS / np.sqrt(2.0 * freedom)) < left < ENOUGH * expected:
        units = {"revolute": (np.degrees(1.0), "deg"), "prismatic": (1e3, "mm")}
        sizes = {units[j.kind]: d for j, d in zip(mechanism.joints, steps.tolist(), strict=True) if d}
        said = [f"joint values are rounded to {factor * d:.3g} {unit}" for (factor, unit), d in sizes.items()]
        said = said if ENOUGH * turned > written else []
        said += [f"positions are rounded to {1e3 * step:.3g} mm"] if ENOUGH * written > turned else []
        yield (
            f"rounding explains the residual: {' and '.join(said)}, which causes {1e3 * expected:.3g} mm RMS; expected "
            "more digits"
        )


def rounding(data: Dataset) -> float:
    """Return the largest RMS position error, m, by rounding of joint values and positions, as if every joint had the
    full reach of the arm as lever."""
    step, steps = last_digits(data)
    whole = data.position[np.isfinite(data.position).all(axis=1)]
    reach = float(np.sqrt(np.mean(np.sum((whole - whole.mean(axis=0)) ** 2, axis=1)))) if len(whole) else 0.0
    levers = np.where(_revolute(data), reach, 1.0)
    return float(SPREAD * np.hypot(np.sqrt(3.0) * step, np.linalg.norm(steps * levers)))


def last_digits(data: Dataset) -> tuple[float, Array]:
    """Return the size of the last decimal of all positions, m, and of each joint's values, rad or m.

    Joints of one kind have the decimals of one unit (deg, rad; mm) in common. Zero: no common decimal.
    """
    turns = _revolute(data)
    angles, travels = data.q[:, turns], data.q[:, ~turns]
    angle = max(float(np.radians(_last(np.degrees(angles)))), _last(angles))
    return 1e-3 * _last(1e3 * data.position), np.where(turns, angle, 1e-3 * _last(1e3 * travels))


def _revolute(data: Dataset) -> Mask:
    return np.array([kind == "revolute" for kind in data.kinds or ("revolute",) * data.q.shape[1]])


def _last(values: Array) -> float:
    """Return the size of the last decimal that all values have in common, zero if there is none."""
    known = values[np.isfinite(values)]
    for digits in range(-1, MOST_DIGITS):
        scaled = known * 10.0**digits
        if len(known) and np.abs(scaled - np.round(scaled)).max() < 1e-4:
            return 10.0**-digits
    return 0.0
