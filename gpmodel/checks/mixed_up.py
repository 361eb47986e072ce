"""Columns mixed up or in the wrong unit, recognised by how much better another reading fits the mechanism."""

from collections.abc import Iterator

import numpy as np
from scipy import optimize

from gpmodel.arrays import Array, IntArray
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset

TURNS = 4 * np.pi
"""Radians: no joint of a robot turns more than twice either way."""
POOR_SHARE, POOR_LENGTH = 0.02, 0.01
"""Share of the workspace, and metres, that registration and tool leave of a table before another reading is tried:
ten times what a bad robot is off by."""
FAR_BETTER = 5.0
"""Times better another reading has to fit: a mechanism described wrongly is not fitted so much better by chance."""
GOOD_SHARE = 0.05
"""Share of the spread of the points that the right reading leaves at most."""
MOST_SHARE = 0.85
"""Share of the poses that decide: up to 15 % may be gross errors."""
HOPELESS_SHARE, HOPELESS_LENGTH = 0.1, 0.03
"""Share of the spread, and metres, left where no reading fits and the table is refused: no robot that moves is so far
off."""
FEWEST_ROWS, MOST_ROWS = 6, 60
"""Poses between which readings are compared: fewer than six fit anything, more than sixty say nothing new."""
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "cm": 1e-2}
"""Metres of the units that tables of lengths are written in."""


def mixed_up(mechanism: Mechanism, data: Dataset) -> str | None:
    """What looks mixed up, and how to write it; None where the table fits the mechanism as it stands.

    Only where registration and tool alone leave far more than any real mechanism's errors, at most of the poses,
    other readings are tried: joint values in the other angle unit, lengths in another unit, a mirrored x y z, a
    joint's sign, two joints swapped. One that leaves FAR_BETTER times less is what the table must have meant. Of
    several arms only degrees read as radians are looked for.
    """
    revolute = np.array([j.kind == "revolute" for j in mechanism.joints])
    largest = np.abs(data.q[:, revolute]).max(initial=0.0)
    rows = _comparable_rows(data)
    if len(rows) < FEWEST_ROWS or branched(mechanism):
        return _degrees_read_as_radians(largest) if largest > TURNS else None
    q, p, now = _typical(mechanism, data.q[rows], data.position[rows])
    spread, reach = spread_of(p), spread_of(se3.chain(mechanism.transforms(q))[-1][:, :3, 3])
    if now < max(POOR_LENGTH, POOR_SHARE * min(spread, reach)):
        return None
    best, text = now, None
    for meaning, other_q, other_p in _readings(mechanism, q, p, revolute, spread, reach):
        if least_misfit(mechanism, other_q, other_p) > best / FAR_BETTER:
            continue
        left = misfit(mechanism, other_q, other_p)
        if left < best / FAR_BETTER and left < GOOD_SHARE * spread_of(other_p):
            best = left
            text = f"{meaning}; registration alone then leaves {1e3 * left:.3g} mm, as it stands {1e3 * now:.3g} mm"
    if text is None and largest > TURNS:
        return _degrees_read_as_radians(largest)
    hopeless = now > max(HOPELESS_LENGTH, HOPELESS_SHARE * spread) and all(j.measured for j in mechanism.joints)
    if text is None and hopeless:
        return (
            f"the positions do not fit {mechanism.name}: registration and tool leave {1e3 * now:.3g} mm of their "
            f"spread of {1e3 * spread:.3g} mm; expected the right mechanism, joint order, signs and units"
        )
    return text


def _comparable_rows(data: Dataset) -> IntArray:
    """Some rows with a whole position, all of the most frequent set-up and tool."""
    places = [f"{s}\0{t}" for s, t in zip(data.label("setup").tolist(), data.label("tool").tolist(), strict=True)]
    usual = np.array(places) == max(set(places), key=places.count)
    rows = np.flatnonzero(np.isfinite(data.position).all(axis=1) & usual)
    return rows[:: max(1, len(rows) // MOST_ROWS)]


def _typical(mechanism: Mechanism, q: Array, position: Array) -> tuple[Array, Array, float]:
    """The poses without those that fit worst, and their misfit: gross errors are no mix-up of columns."""
    now, error = misfit_by_pose(mechanism, q, position)
    for _ in range(2):
        most = np.sort(np.argsort(error)[: max(FEWEST_ROWS, round(MOST_SHARE * len(error)))])
        q, position = q[most], position[most]
        now, error = misfit_by_pose(mechanism, q, position)
    return q, position, now


def misfit(mechanism: Mechanism, q: Array, position: Array) -> float:
    """RMS distance, m, that registration and one tool point leave: q (N, n), position (N, 3)."""
    return misfit_by_pose(mechanism, q, position)[0]


def misfit_by_pose(mechanism: Mechanism, q: Array, position: Array) -> tuple[float, Array]:
    """The same, and the distance (N,) left at each pose.

    Searched from all sides of the flange: where it turns about one centre, a point on the wrong side fits best near by.
    """
    frames: Array = se3.chain(mechanism.transforms(q))[-1]

    def residual(point: Array) -> Array:
        tips = frames[:, :3, 3] + frames[:, :3, :3] @ point
        turn, shift = se3.fit_rotation(tips, position)
        return (position - tips @ turn.T - shift).ravel()

    best, error = np.inf, np.zeros(len(q))
    for start in np.vstack([np.zeros(3), 0.2 * np.eye(3), -0.2 * np.eye(3)]):
        found = optimize.least_squares(residual, start, x_scale=0.1, max_nfev=12)
        if (rms := float(np.sqrt(2 * found.cost / len(q)))) < best:
            best, error = rms, np.linalg.norm(found.fun.reshape(-1, 3), axis=1)
        if best < POOR_LENGTH:
            break
    return best, error


def least_misfit(mechanism: Mechanism, q: Array, position: Array) -> float:
    """RMS distance, m, below which no registration and tool point can come: position as any linear function of the
    flange's position and of all entries of its rotation, p = s + A t + B vec R."""
    frames = se3.chain(mechanism.transforms(q))[-1]
    columns = np.hstack([np.ones((len(q), 1)), frames[:, :3, 3], frames[:, :3, :3].reshape(len(q), 9)])
    left = position - columns @ np.linalg.lstsq(columns, position, rcond=None)[0]
    return root_mean_square(np.linalg.norm(left, axis=1))


def spread_of(points: Array) -> float:
    """RMS distance of points (N, k) from their centre."""
    return root_mean_square(np.linalg.norm(points - points.mean(axis=0), axis=1))


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
