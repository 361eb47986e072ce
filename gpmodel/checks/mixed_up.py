"""Columns mixed up or in the wrong unit, recognised by how much better another reading fits the mechanism."""

from itertools import chain
from operator import itemgetter

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.checks.misfit import Registered, core, flange, gross, least_misfit, registered, spread_of
from gpmodel.checks.readings import of_joints, of_lengths, of_the_mechanism
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.outliers import OUTLIER_SHARE
from gpmodel.table.dataset import Dataset
from gpmodel.wording import some

TURNS = 4 * np.pi
"""Radians: no joint of a robot turns more than twice either way."""
POOR_SHARE, POOR_LENGTH = 0.02, 0.01
"""Share of the workspace, and metres, that registration and tool leave of a table before any reading of any column is
tried: ten times what a bad robot is off by. Below it see `checks.weak_columns`."""
FAR_BETTER = 5.0
"""Times better another reading has to fit: a mechanism described wrongly is not fitted so much better by chance."""
GOOD_SHARE = 0.05
"""Share of the spread of the points that the right reading leaves at most."""
HOPELESS_SHARE, HOPELESS_LENGTH = 0.1, 0.03
"""Share of the spread, and metres, left where no reading fits and the table is refused: no robot that moves is so far
off."""
FEWEST_ROWS, MOST_ROWS, MOST_IN_ORDER = 6, 60, 400
"""Poses between which readings are compared: fewer than six fit anything, more than sixty show nothing new. Rows, one
after the other, in which a lost one is looked for."""
FEWEST_OF_A_PART, LEAST_PART = 12, 0.35
"""Rows, and share of them, that fit one registration and tool where the others are called bad: nine unknowns fit three
rows whatever they hold."""
TINY, GIANT = 5e-3, 30.0
"""Metres that the longest link of no robot is below, and above."""


def mixed_up(mechanism: Mechanism, data: Dataset) -> str | None:
    """Name mixed-up columns and how to write them; None where the table fits the mechanism.

    Where registration and tool alone leave far more than any real mechanism's errors, at most of the poses, other
    readings are tried: units, signs, columns swapped or coupled, lengths of the mechanism, then rows that belong to the
    pose before or after, two set-ups in one, and many bad readings. One that leaves FAR_BETTER times less is what the
    table must have meant. Of several arms only degrees read as radians are looked for.
    """
    revolute = np.array([j.kind == "revolute" for j in mechanism.joints])
    largest = np.abs(data.q[:, revolute]).max(initial=0.0)
    rows = comparable_rows(data)
    if len(rows) < FEWEST_ROWS or branched(mechanism):
        return _degrees_read_as_radians(largest) if largest > TURNS else None
    few = rows[:: max(1, len(rows) // MOST_ROWS)]
    frames = flange(mechanism, data.q[few])
    most, errors = typical(frames, data.position[few])
    q, p, now = data.q[few][most], data.position[few][most], root_mean_square(errors[most])
    spread, reach = spread_of(p), spread_of(frames[most, :3, 3])
    poor = now >= max(POOR_LENGTH, POOR_SHARE * min(spread, reach))
    text = _better(mechanism, q, p, now, (spread, reach)) if poor else None
    if text is None and (poor or np.mean(errors > gross(errors)) > OUTLIER_SHARE):
        text = _of_the_rows(mechanism, data, rows[:MOST_IN_ORDER], root_mean_square(errors))
    if not poor:
        return text
    if text is None and largest > TURNS:
        return _degrees_read_as_radians(largest)
    hopeless = now > max(HOPELESS_LENGTH, HOPELESS_SHARE * spread) and all(j.measured for j in mechanism.joints)
    if text is None and hopeless:
        return (
            f"the positions do not fit {mechanism.name}: registration and tool leave {1e3 * now:.3g} mm of their "
            f"spread of {1e3 * spread:.3g} mm; expected the right mechanism, joint order, signs and units"
        )
    return text


def _better(mechanism: Mechanism, q: Array, p: Array, now: float, sizes: tuple[float, float]) -> str | None:
    """The reading that fits best, where one fits FAR_BETTER. sizes: spread of the points and of the flange, m."""
    best, text = now, None
    longest = float(np.abs(mechanism.transforms(q)[..., :3, 3]).max())
    readings = [of_lengths(q, p, *sizes)]
    if not closed(mechanism):  # other joint values of closed loops meet nowhere
        readings = [of_joints(mechanism, q, p), *readings]
    if not TINY < longest < GIANT:
        readings = [of_the_mechanism(mechanism.name, q, p)]
    for reading in chain.from_iterable(readings):
        frames = flange(mechanism, reading.q, reading.scale)
        if least_misfit(frames, reading.position) > best / FAR_BETTER:
            continue
        left = root_mean_square(registered(frames, reading.position).errors(frames, reading.position))
        if left < best / FAR_BETTER and left < GOOD_SHARE * spread_of(reading.position):
            best, text = left, reading.meaning
    if text is None:
        return None
    return f"{text}; registration alone then leaves {1e3 * best:.3g} mm, as it stands {1e3 * now:.3g} mm"


def comparable_rows(data: Dataset) -> IntArray:
    """Rows with a whole position, all of the most frequent set-up and tool."""
    places = [f"{s}\0{t}" for s, t in zip(data.label("setup").tolist(), data.label("tool").tolist(), strict=True)]
    usual = np.array(places) == max(set(places), key=places.count)
    return np.flatnonzero(np.isfinite(data.position).all(axis=1) & usual)


def typical(frames: Array, position: Array) -> tuple[IntArray, Array]:
    """The poses (K,) without those that fit worst, by index, and the errors (N,), m, of all by what is fitted to these:
    gross errors are no mix-up of columns."""
    most = np.arange(len(frames))
    for _ in range(3):
        found = registered(frames[most], position[most])
        errors = found.errors(frames, position)
        best, most = most, np.sort(np.argsort(errors)[: max(FEWEST_ROWS, round((1.0 - OUTLIER_SHARE) * len(most)))])
    return best, errors


def _of_the_rows(mechanism: Mechanism, data: Dataset, rows: IntArray, now: float) -> str | None:
    """A row lost, two set-ups in one, or many bad readings: a large part of the rows that fits by itself tells."""
    frames, p, row = flange(mechanism, data.q[rows]), data.position[rows], data.row[rows]
    parts = []
    for shift in (0, 1, -1):
        paired = _paired(frames, p, shift)
        found, good = core(*paired)
        left = root_mean_square(found.errors(*paired)[good])
        if good.sum() >= max(FEWEST_OF_A_PART, LEAST_PART * len(rows)) and left <= now / FAR_BETTER:
            parts.append((int(good.sum()), shift, found))
    if not parts:
        return None
    _, shift, found = max(parts, key=itemgetter(0))
    return _lost_row(found, frames, p, row) or (_bad_rows(frames, p, row, found) if shift == 0 else None)


def _paired(frames: Array, p: Array, shift: int) -> tuple[Array, Array]:
    """Poses and the positions `shift` rows after them."""
    count = len(p) - abs(shift)
    start, after = max(-shift, 0), max(shift, 0)
    return frames[start : start + count], p[after : after + count]


def _lost_row(found: Registered, frames: Array, p: Array, row: IntArray) -> str | None:
    """From which row on positions belong to the pose before or after; None where that does not explain nearly all."""
    errors = np.full((3, len(p)), np.inf)
    for shift in (-1, 0, 1):
        errors[shift + 1, max(shift, 0) : len(p) + min(shift, 0)] = found.errors(*_paired(frames, p, shift))
    missed = errors > gross(errors.min(axis=0))
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
        f"{where}every position looks as if it belonged to the pose {way}: a row was lost; put joint values and "
        "positions side by side again"
    )


def _bad_rows(frames: Array, p: Array, row: IntArray, found: Registered) -> str | None:
    """Two set-ups in one, where the others fit a registration of their own; else bad readings, by row."""
    error = found.errors(frames, p)
    bad = error > gross(error)
    if bad.mean() <= OUTLIER_SHARE:
        return None
    rows = some(row[bad].tolist())
    if bad.sum() >= FEWEST_OF_A_PART:
        other, same = core(frames[bad], p[bad])
        left = root_mean_square(other.errors(frames[bad][same], p[bad][same]))
        if same.mean() > 1.0 - OUTLIER_SHARE and left < root_mean_square(error[bad]) / FAR_BETTER:
            return (
                f"two set-ups or tools in one table: {int(bad.sum())} rows ({rows}) fit a registration of their own; "
                "name each set-up in a column 'setup', or each tool in a column 'tool'"
            )
    return (
        f"{int(bad.sum())} of {len(p)} readings are up to {1e3 * error[bad].max():.3g} mm off (rows {rows}): too many "
        "to leave out; expected positions measured in these poses"
    )


def _degrees_read_as_radians(largest: float) -> str:
    return (
        f"joint values reach {largest:.4g} rad ({largest / (2 * np.pi):.3g} turns); "
        f"they look like degrees: write [deg] in their headers"
    )
