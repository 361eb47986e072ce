"""Find table columns that are exchanged or in a wrong unit: another interpretation fits the mechanism far better."""

from collections.abc import Iterable, Iterator
from itertools import chain, groupby, islice, product
from operator import attrgetter, itemgetter

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array, IntArray
from gpmodel.checks.formulas import formula_readings
from gpmodel.checks.notes import (
    POOR_LENGTH,
    POOR_SHARE,
    Registered,
    consistent_rows,
    flange,
    gross_error_limit,
    least_misfit,
    registered,
    spread_of,
)
from gpmodel.checks.readings import (
    ALIKE,
    SCREENED,
    Reading,
    joint_readings,
    length_readings,
    mechanism_readings,
    order_readings,
    sign_readings,
)
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import OUTLIER_SHARE, root_mean_square
from gpmodel.table.dataset import Dataset
from gpmodel.wording import some

TURNS = 4 * np.pi
"""Largest joint angle, rad: no joint of a robot makes more than two turns in one direction."""
FAR_BETTER = 5.0
"""Least factor by which another interpretation of the columns has to reduce the residual. With a wrong description of a
mechanism, no alternative interpretation reduces the residual as much by chance."""
GOOD_SHARE = 0.05
"""Largest residual of a correct interpretation of table columns, as a share of the spread of the points."""
HOPELESS_SHARE, HOPELESS_LENGTH = 0.1, 0.03
"""Residual, as a share of the points' spread and in m, from which a table without a fitting interpretation is refused.
No working robot has errors of 3 cm or a tenth of the spread."""
FEWEST_ROWS, MOST_ROWS, MOST_IN_ORDER = 6, 60, 400
"""Least and largest number of poses to compare interpretations of columns: with fewer than six poses all fit, more than
sixty add no information. Largest number of consecutive rows in which a lost row is searched."""
FEWEST_OF_A_PART, LEAST_PART = 12, 0.35
"""Least number and least share of rows that must fit one registration and tool before the other rows are called bad:
nine unknowns fit any three rows."""
TINY, GIANT = 5e-3, 30.0
"""Bounds of the length of the longest link of a robot, m."""


def mixed_up(mechanism: Mechanism, data: Dataset) -> str | None:
    """Name table columns that are exchanged or in a wrong unit, with the correction; None if the table fits.

    If the residual of registration and tool is far above real errors at most poses, other interpretations of the
    columns are tried: units, signs, columns swapped or coupled, lengths of the mechanism, then rows that belong to the
    pose before or after, two set-ups in one, and many bad measurements. An interpretation is named if it divides the
    residual by at least five. For several arms, joint values in degrees instead of radians
    are the only tested interpretation.
    """
    revolute = np.array([j.kind == "revolute" for j in mechanism.joints])
    largest = np.abs(data.q[:, revolute]).max(initial=0.0)
    rows = comparable_rows(data)
    if len(rows) < FEWEST_ROWS or branched(mechanism):
        return _too_many_turns(largest) if largest > TURNS else None
    few = rows[:: max(1, len(rows) // MOST_ROWS)]
    frames = flange(mechanism, data.q[few])
    most, errors = typical_rows(frames, data.position[few])
    q, p, now = data.q[few][most], data.position[few][most], root_mean_square(errors[most])
    spread, reach = spread_of(p), spread_of(frames[most, :3, 3])
    poor = now >= max(POOR_LENGTH, POOR_SHARE * min(spread, reach))
    hopeless = now > max(HOPELESS_LENGTH, HOPELESS_SHARE * spread)
    text = _better(mechanism, q, p, now, (spread, reach), hopeless) if poor else None
    if text is None and (now >= POOR_LENGTH or np.mean(errors > gross_error_limit(errors)) > OUTLIER_SHARE):
        text = row_faults(mechanism, data, root_mean_square(errors))
    if not poor:
        return text
    if text is None and largest > TURNS:
        return _too_many_turns(largest)
    if text is None and hopeless and all(j.measured for j in mechanism.joints):
        return (
            f"the positions do not fit {mechanism.name}: {1e3 * now:.3g} mm remain after registration and tool, of a "
            f"spread of {1e3 * spread:.3g} mm; expected the right mechanism, joint order, signs and units"
        )
    return text


def _better(
    mechanism: Mechanism, q: Array, p: Array, now: float, sizes: tuple[float, float], hopeless: bool
) -> str | None:
    """Describe the columns' best interpretations if they divide the residual by at least five.

    now: RMS residual of the unchanged table, m.
    sizes: spread of the points and of the flange, m.
    hopeless: True to try changes of several columns together, and of the order of all columns.
    """
    longest = float(np.abs(mechanism.transforms(q)[..., :3, 3]).max())
    kinds = [length_readings(q, p, *sizes)]
    if not closed(mechanism):  # other joint values of closed loops meet nowhere
        kinds.insert(0, chain(joint_readings(mechanism, q, p), sign_readings(mechanism, q, p)))
    if not TINY < longest < GIANT:
        kinds = [mechanism_readings(mechanism.name, q, p)]
    found = [fit for kind in kinds if (fit := _best_of(mechanism, kind, now / FAR_BETTER))]
    if not found and hopeless and not closed(mechanism):
        several, limit = (formula_readings(mechanism, q, p), order_readings(mechanism, q, p)), now / FAR_BETTER
        found = [fit for kind in several if (fit := _best_of(mechanism, kind, limit))]
    if not found:
        return None
    least = min(left for left, _ in found)
    said = ", or ".join(text for left, text in sorted(found) if left < ALIKE * least)
    return f"{said}; residual after registration: {1e3 * least:.3g} mm instead of {1e3 * now:.3g} mm"


def _best_of(mechanism: Mechanism, readings: Iterable[Reading], limit: float) -> tuple[float, str] | None:
    """Return residual [m] and meaning of the first best interpretation of the columns with a residual below `limit`."""
    fits: list[tuple[int, float, str]] = []
    number = 0
    for scale, alike in groupby(readings, key=attrgetter("scale")):
        while part := list(islice(alike, SCREENED)):
            frames = flange(mechanism, np.concatenate([r.q for r in part]), scale).reshape(len(part), -1, 4, 4)
            bounds = least_misfit(frames, np.stack([r.position for r in part]))
            for k in np.argsort(bounds).tolist():
                p = part[k].position
                good = GOOD_SHARE * spread_of(p)
                if bounds[k] < min(limit, good):
                    left = root_mean_square(registered(frames[k], p).errors(frames[k], p))
                    if left < good:
                        fits.append((number + k, left, part[k].meaning))
                        limit = min(limit, ALIKE * left)
            number += len(part)
    return next(((left, meaning) for _, left, meaning in sorted(fits) if left < limit), None)


def comparable_rows(data: Dataset) -> IntArray:
    """Return the indices of the rows with a measured x, y and z, of the most frequent set-up and tool."""
    places = [f"{s}\0{t}" for s, t in zip(data.label("setup").tolist(), data.label("tool").tolist(), strict=True)]
    usual = np.array(places) == max(set(places), key=places.count)
    return np.flatnonzero(np.isfinite(data.position).all(axis=1) & usual)


def typical_rows(frames: Array, position: Array) -> tuple[IntArray, Array]:
    """Return the indices of the poses except the worst, and the error of every pose, m, by a fit without the worst.

    Gross errors of single poses are no sign of exchanged columns.
    """
    most = np.arange(len(frames))
    for _ in range(3):
        found = registered(frames[most], position[most])
        errors = found.errors(frames, position)
        best, most = most, np.sort(np.argsort(errors)[: max(FEWEST_ROWS, round((1.0 - OUTLIER_SHARE) * len(most)))])
    return best, errors


def row_faults(mechanism: Mechanism, data: Dataset, now: float) -> str | None:
    """Find a lost row, a column shifted by a row, two mixed set-ups, or bad measurements, from the rows that fit.

    now: RMS residual of registration and tool, m.
    """
    rows = comparable_rows(data)[:MOST_IN_ORDER]
    if len(rows) < FEWEST_ROWS or branched(mechanism):
        return None
    frames, p, row = flange(mechanism, data.q[rows]), data.position[rows], data.row[rows]
    parts = []
    for shift in (0, 1, -1):
        paired = _paired(frames, p, shift)
        found, good = consistent_rows(*paired)
        left = root_mean_square(found.errors(*paired)[good])
        if good.sum() >= max(FEWEST_OF_A_PART, LEAST_PART * len(rows)) and left <= now / FAR_BETTER:
            parts.append((int(good.sum()), shift, found))
    if not parts:
        return _late_column(mechanism, data.q[rows], p, now)
    _, shift, found = max(parts, key=itemgetter(0))
    return _lost_row(found, frames, p, row) or (_bad_rows(frames, p, row, found) if shift == 0 else None)


def _late_column(mechanism: Mechanism, q: Array, p: Array, now: float) -> str | None:
    """Name the joint whose values belong to the row before or after; None if a shift explains too few rows."""
    for i, shift in product(range(q.shape[1]), (1, -1)):
        moved = q.copy()
        moved[:, i] = np.roll(q[:, i], -shift)
        frames = flange(mechanism, moved[1:-1])
        if least_misfit(frames, p[1:-1]) < now / FAR_BETTER:
            most, errors = typical_rows(frames, p[1:-1])
            if root_mean_square(errors[most]) < now / FAR_BETTER:
                return (
                    f"column '{mechanism.joints[i].name}' is probably a row {'late' if shift > 0 else 'early'}; "
                    "align the "
                    "column with the other joints"
                )
    return None


def _paired(frames: Array, p: Array, shift: int) -> tuple[Array, Array]:
    """Return the frames of poses, and the measured positions `shift` rows later in the table."""
    count = len(p) - abs(shift)
    start, after = max(-shift, 0), max(shift, 0)
    return frames[start : start + count], p[after : after + count]


def _lost_row(found: Registered, frames: Array, p: Array, row: IntArray) -> str | None:
    """Name the row from which positions belong to the pose before or after; None if a shift explains too few rows."""
    errors = np.full((3, len(p)), np.inf)
    for shift in (-1, 0, 1):
        errors[shift + 1, max(shift, 0) : len(p) + min(shift, 0)] = found.errors(*_paired(frames, p, shift))
    missed = errors > gross_error_limit(errors.min(axis=0))
    if missed[1].mean() <= OUTLIER_SHARE:
        return None
    before = np.hstack([np.zeros((3, 1)), np.cumsum(missed, axis=1)])
    wrong = {
        (first, then, at): (before[first, at] + before[then, -1] - before[then, at]) / len(p)
        for first in range(3)
        for then in range(3)
        for at in range(len(p))
        if first != then or (at == 0 and then != 1)
    }
    (first, then, at), share = min(wrong.items(), key=lambda item: item[1])
    if share > OUTLIER_SHARE:
        return None
    where = f"from about row {row[at]} on " if at else ""
    way = "before" if then > first or (first == then and then == 2) else "after"
    return (
        f"{where}every position probably belongs to the pose {way} (a row was lost); align joint values and positions"
    )


def _bad_rows(frames: Array, p: Array, row: IntArray, found: Registered) -> str | None:
    """Report two mixed set-ups if the rows that do not fit have a second registration; else list the rows of bad
    measurements."""
    error = found.errors(frames, p)
    bad = error > gross_error_limit(error)
    if bad.mean() <= OUTLIER_SHARE:
        return None
    rows = some(row[bad].tolist())
    if bad.sum() >= FEWEST_OF_A_PART:
        other, same = consistent_rows(frames[bad], p[bad])
        left = root_mean_square(other.errors(frames[bad][same], p[bad][same]))
        if same.mean() > 1.0 - OUTLIER_SHARE and left < root_mean_square(error[bad]) / FAR_BETTER:
            return (
                f"two set-ups or tools in one table: {int(bad.sum())} rows ({rows}) need another registration; "
                "name each set-up in a column 'setup', or each tool in a column 'tool'"
            )
    return (
        f"{int(bad.sum())} of {len(p)} measurements have errors up to {1e3 * error[bad].max():.3g} mm (rows "
        f"{rows}): too many "
        "to exclude; expected positions measured at these poses"
    )


def _too_many_turns(largest: float) -> str:
    return (
        f"joint values reach {largest:.4g} rad ({largest / (2 * np.pi):.3g} turns), more than a joint turns; "
        "expected [deg] in the headers of degrees, [rad] in those of radians"
    )


COARSE = 0.05
"""Median error of measured rotations over the poses, rad, from which the rotations are refused: three degrees. Errors
of joint zeros are a few milliradians."""
TAIT_BRYAN = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
PROPER = ("xyx", "xzx", "yxy", "yzy", "zxz", "zyz")


def rotations_flaw(mechanism: Mechanism, data: Dataset) -> str | None:
    """Describe how measured rotations disagree with the mechanism, and the convention that fits; None for agreement.

    Model: measured rotation = A R_flange B, with the registration A of the positions and the rotation B of the tool in
    the flange. Without measured positions the rotations are not tested.
    """
    rows = comparable_rows(data)
    rows = rows[np.isfinite(data.rotation[rows]).all(axis=1)]
    if len(rows) < FEWEST_ROWS or branched(mechanism) or not all(j.measured for j in mechanism.joints):
        return None
    frames = flange(mechanism, data.q[rows])
    turned = registered(frames, data.position[rows]).turn @ frames[:, :3, :3]
    vectors = data.rotation[rows]
    now = rotation_misfit(turned, Rotation.from_rotvec(vectors).as_matrix())
    if now < COARSE:
        return None
    misses = {name: rotation_misfit(turned, rotations) for name, rotations in _conventions(vectors)}
    best = min(misses, key=lambda name: round(misses[name], 6))
    said = f"rx, ry, rz differ from the rotations of the mechanism by {np.degrees(now):.3g} deg"
    if misses[best] > min(COARSE, now / FAR_BETTER):
        return (
            f"{said}, in every other convention by at least {np.degrees(misses[best]):.3g}; expected rotation "
            "vectors (axis "
            "times angle) in the axes of x, y, z, measured at the pose of the row"
        )
    return (
        f"{said}; read as {best}, by {1e3 * misses[best]:.3g} mrad: import the table in this convention "
        "(gpmodel import "
        "--map, [orientation])"
    )


def rotation_misfit(turned: Array, measured: Array) -> float:
    """Return the median angle, rad, between measured rotations and `turned` times the best constant rotation."""
    relative = np.swapaxes(turned, 1, 2) @ measured
    tool = se3.nearest_rotation(relative.sum(axis=0))
    return float(np.median(np.linalg.norm(se3.rotation_vector(relative @ tool.T), axis=1)))


def _conventions(vectors: Array) -> Iterator[tuple[str, Array]]:
    """Yield the name of each convention of rotations, and `vectors` as rotation matrices by the convention."""
    as_read = Rotation.from_rotvec(vectors)
    quaternions = as_read.as_quat()
    for factor, unit in ((1.0, ""), (np.pi / 180, " in degrees"), (180 / np.pi, " in radians")):
        angles = factor * vectors
        if unit:
            yield f"rotation vector{unit}", Rotation.from_rotvec(angles).as_matrix()
        yield f"the inverse{unit}", Rotation.from_rotvec(-angles).as_matrix()
        for order, fixed in product((*TAIT_BRYAN, *PROPER), (True, False)):
            axes = order if fixed else order.upper()
            name = f"{'fixed' if fixed else 'intrinsic'} {order.upper()} of"
            yield f"{name} rx, ry, rz{unit}", Rotation.from_euler(axes, angles).as_matrix()
            if order in TAIT_BRYAN and order != "xyz":
                own = angles[:, ["xyz".index(axis) for axis in order]]
                listed = ", ".join(f"r{axis}" for axis in order)
                yield f"{name} {listed}{unit}", Rotation.from_euler(axes, own).as_matrix()
    yield "quaternion wxyz", Rotation.from_quat(quaternions[:, [1, 2, 3, 0]]).as_matrix()
    yield "quaternion xyzw", Rotation.from_quat(quaternions[:, [3, 0, 1, 2]]).as_matrix()
    short = np.linalg.norm(vectors, axis=1).max() <= 1.0 + 1e-6
    if short:
        scalar = np.sqrt(np.maximum(1.0 - np.sum(vectors**2, axis=1), 0.0))
        yield "x, y, z of a quaternion", Rotation.from_quat(np.column_stack([vectors, scalar])).as_matrix()
    for axis in range(3):
        mirrored = np.where(np.arange(3) == axis, vectors, -vectors)
        yield f"left-handed, {'xyz'[axis]} mirrored", Rotation.from_rotvec(mirrored).as_matrix()
