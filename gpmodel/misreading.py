"""Columns mixed up or in the wrong unit, recognised by how much better another reading fits the mechanism."""

from collections.abc import Iterator

import numpy as np
from scipy import optimize

from gpmodel import se3
from gpmodel.dataset import Dataset
from gpmodel.mechanism import Array, Mechanism

TURNS = 4 * np.pi
POOR_SHARE, POOR_LENGTH = 0.02, 0.01
FAR_BETTER = 5.0
MOST_ROWS = 60
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "cm": 1e-2}


def misreading(mechanism: Mechanism, data: Dataset) -> str | None:
    """What looks mixed up, and how to write it; None where the table fits the mechanism as it stands.

    Only where registration and tool alone leave far more than any real mechanism's errors, other readings are
    tried: joint values in the other angle unit, lengths in another unit, a mirrored x y z, a joint's sign, two
    joints swapped. One that leaves FAR_BETTER times less is what the table must have meant.
    """
    revolute = np.array([j.kind == "revolute" for j in mechanism.joints])
    largest = np.abs(data.q[:, revolute]).max(initial=0.0)
    measured = np.flatnonzero(np.isfinite(data.position).all(axis=1))
    if len(measured) < 6:
        if largest > TURNS:
            return _degrees_read_as_radians(largest)
        return None
    rows = measured[:: max(1, len(measured) // MOST_ROWS)]
    setup = data.label("setup")[rows]
    rows = rows[setup == max(set(setup.tolist()), key=setup.tolist().count)]
    q, p = data.q[rows], data.position[rows]
    now = misfit(mechanism, q, p)
    spread = float(np.sqrt(np.mean(np.sum((p - p.mean(axis=0)) ** 2, axis=1))))
    reach = _spread(mechanism, q)
    if now < max(POOR_LENGTH, POOR_SHARE * min(spread, reach)):
        return None
    best, text = now, None
    for meaning, other_q, other_p in _readings(mechanism, q, p, revolute, spread, reach):
        size = float(np.sqrt(np.mean(np.sum((other_p - other_p.mean(axis=0)) ** 2, axis=1))))
        left = misfit(mechanism, other_q, other_p)
        if left < best / FAR_BETTER and left < 0.05 * size:
            best, text = (
                left,
                f"{meaning}; registration alone then leaves {1e3 * left:.3g} mm, as it stands {1e3 * now:.3g} mm",
            )
    if text is None and largest > TURNS:
        return _degrees_read_as_radians(largest)
    return text


def misfit(mechanism: Mechanism, q: Array, position: Array) -> float:
    """RMS distance, m, that registration and one tool point leave: q (N, n), position (N, 3)."""
    frames = se3.chain(mechanism.transforms(q))[-1]

    def residual(point: Array) -> Array:
        tips = frames[:, :3, 3] + frames[:, :3, :3] @ point
        turn, shift = se3.fit_rotation(tips, position)
        return (position - tips @ turn.T - shift).ravel()

    best = np.inf
    for start in np.vstack([np.zeros(3), 0.2 * np.eye(3)]):
        found = optimize.least_squares(residual, start, x_scale=0.1, max_nfev=12)
        best = min(best, float(np.sqrt(2 * found.cost / len(q))))
        if best < POOR_LENGTH:
            break
    return best


def _spread(mechanism: Mechanism, q: Array) -> float:
    tips = se3.chain(mechanism.transforms(q))[-1][:, :3, 3]
    return float(np.sqrt(np.mean(np.sum((tips - tips.mean(axis=0)) ** 2, axis=1))))


def _degrees_read_as_radians(largest: float) -> str:
    return (
        f"joint values reach {largest:.4g} rad ({largest / (2 * np.pi):.3g} turns); "
        f"they look like degrees: write [deg] in their headers"
    )


def _readings(
    mechanism: Mechanism, q: Array, p: Array, revolute: Array, spread: float, reach: float
) -> Iterator[tuple[str, Array, Array]]:
    joints = mechanism.joints
    for factor, given, meant in ((np.pi / 180, "radians", "deg"), (180 / np.pi, "degrees", "rad")):
        scaled = np.where(revolute, q * factor, q)
        what = f"joint values given as {given} look like {'degrees' if meant == 'deg' else 'radians'}"
        yield f"{what}: write [{meant}] in their headers", scaled, p
        for i in np.flatnonzero(revolute):
            one = q.copy()
            one[:, i] *= factor
            yield f"column '{joints[i].name}' looks like [{meant}], given as {given}", one, p
    for ratio in sorted({a / b for a in LENGTHS.values() for b in LENGTHS.values()} - {1.0}):
        if 0.2 < spread * ratio / max(reach, 1e-9) < 5.0:
            yield f"x, y and z look {_wrong_by(ratio)}", q, p * ratio
        for k, axis in enumerate("xyz"):
            if ratio in (1e3, 1e-3, 25.4, 1 / 25.4):
                one = p.copy()
                one[:, k] *= ratio
                yield f"column '{axis}' looks {_wrong_by(ratio)}", q, one
    yield "two of the columns x, y, z look swapped, or one has the wrong sign", q, p * np.array([-1.0, 1.0, 1.0])
    for k, joint in enumerate(joints):
        flipped = q.copy()
        flipped[:, k] *= -1
        yield f"column '{joint.name}' looks counted the other way round", flipped, p
    for k in range(len(joints) - 1):
        order = np.arange(len(joints))
        order[[k, k + 1]] = k + 1, k
        yield f"columns '{joints[k].name}' and '{joints[k + 1].name}' look swapped", q[:, order], p


def _wrong_by(ratio: float) -> str:
    pairs = [(a, b) for a in LENGTHS for b in LENGTHS if np.isclose(LENGTHS[a] / LENGTHS[b], ratio, rtol=1e-9)]
    size = f"{ratio:g} times too small" if ratio > 1 else f"{1 / ratio:g} times too large"
    return f"{size}, as {' or '.join(f'[{meant}] given as [{given}]' for meant, given in pairs)}"
