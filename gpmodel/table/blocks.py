"""Blocks of dependent rows: repeats of a pose, clusters of poses, and labelled groups."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.numerics.interval import chance_of_ratio
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.table.dataset import READ, TOUCHED, Dataset

SAME_JOINT = 5e-4
"""Largest difference between joint values of one pose, rad or m: the last digit of a controller's display (0.01 deg)
plus the motion of a servo at rest (0.02 deg)."""

NEAR = 5.0
"""Largest distance of neighbouring poses in a cluster, relative to the median distance to the nearest pose. With ten or
twenty poses in a small box, the ratio to the median distance is three to five."""

HARDLY_MORE = 1.5
"""Largest growth of the number of pairs of poses within a distance, when the distance doubles, if poses lie in
clusters. The number of pairs of poses is constant for clusters and doubles for poses along a line."""

FAR_JOINT = 10 * SAME_JOINT
"""Difference of joint values, rad or m, above which rows with one `repeat` label are no repeats: 0.3 deg moves a tool
by millimetres."""

FAR_POINT = 0.05
"""Distance, m, above which two measured points belong to different poses: no play or slip is as large."""

FEWEST_POSES = 20
"""Least number of poses for a search for clusters of poses. With fewer poses, a gap between distances is chance."""

FEW_TOUCHES = 12
"""Largest number of touches of one surface, point or bar that form one block, because all touches are needed to locate
the object. If the object has more touches, any half of them locates the object."""

SAMPLE = 50
"""Number of poses that are first searched for clusters, so that a large table without clusters is recognised early."""


def repeat_blocks(dataset: Dataset) -> IntArray:
    """Return the index of the block of each row of the table, from 0.

    No division into folds or held-out poses separates a block. Rows with equal `group` or `repeat` labels form a block.
    A `group` label of all rows is ignored, such as the only training session if another session is held out. Rows that
    touched one point, bar or surface with at most 12 touches form a block. Rows whose joint values agree within 0.5
    mrad or mm, or lie in one cluster, form a block, for any set-up and payload. Blocks are numbered by joint
    values, so that the order of rows does not matter.
    """
    labels = [column for column in ("group", "repeat") if column == "repeat" or np.ptp(dataset.codes(column)[1])]
    links = [_same_label(dataset, column) for column in labels]
    links += [_same_label(dataset, column, FEW_TOUCHES) for column in TOUCHED if column in dataset.labels]
    links += [_same_joints(dataset.q), _clusters(dataset.q)]
    n = len(dataset)
    rows = np.concatenate([np.arange(n)] * len(links))
    graph = coo_array((np.ones(len(rows)), (rows, np.concatenate(links))), shape=(n, n))
    together = connected_components(graph, directed=False)[1]
    return _renumbered(together, np.lexsort(np.round(np.column_stack([dataset.q, dataset.payload]), 9).T[::-1]))


def replicates(dataset: Dataset, whatever: bool = False) -> IntArray:
    """Return a number for each row, equal for repeated measurements at one pose, payload, set-up and tool.

    whatever: True to give one number also to rows of a pose that differ in measurement or set-up.
    Rows with one `repeat` label get one number. Without labels, rows with joint values within 0.5 mrad or mm get one
    number, unless joint values are approximate. A row with a copied measurement gets its own number.
    """
    read = () if whatever else ("setup", "tool", *READ)
    keys = np.column_stack([_of_one_pose(dataset, whatever), *(dataset.codes(c)[1] for c in read)])
    loads = np.unique(np.round(dataset.payload, 9), return_inverse=True)[1]
    return numbered(np.column_stack([keys, loads]))


def _of_one_pose(dataset: Dataset, whatever: bool = False) -> IntArray:
    """Return a number for each row, equal for rows with a common label or pose; with `whatever`, also for copies."""
    labels = dataset.label("repeat")
    same = np.arange(len(dataset)) if dataset.joints_approximate else _same_joints(dataset.q)
    if not whatever:
        again = np.flatnonzero(copies(dataset))
        same[again] = again
    return numbered(np.column_stack([np.where(labels != "", _same_label(dataset, "repeat"), same), labels != ""]))


def poses_of_tips(dataset: Dataset) -> IntArray:
    """Return the pose index of each row of a table; the tips of several arms have separate rows in one pose."""
    same = _same_joints(dataset.q)
    alike = numbered(np.column_stack([same, dataset.codes("tip")[1]]))
    order = np.argsort(alike, kind="stable")
    again = np.empty(len(alike), dtype=np.int64)
    again[order] = np.arange(len(alike)) - np.searchsorted(alike[order], alike[order])
    return numbered(np.column_stack([same, again]))


def numbered(keys: Array | IntArray) -> IntArray:
    """Return a number for each row of a table of keys, equal for rows in which all keys are equal."""
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def different_poses(dataset: Dataset) -> int:
    """Return the number of different poses, less than the rows if poses are repeated or have several markers."""
    return int(replicates(dataset, whatever=True).max(initial=-1)) + 1


def different_readings(dataset: Dataset) -> Dataset:
    """Return the table with the first row of each measurement at each pose, without repeats and copies."""
    once = dataset.subset(~copies(dataset))
    return once.subset(np.sort(np.unique(replicates(once), return_index=True)[1]))


def sharing(dataset: Dataset) -> IntArray:
    """Return a number for each row, equal for rows with correlated errors (a shared deviation from any model).

    Errors are correlated within a cluster of poses, or within one pose if there are no clusters, for one set-up and
    tool and any payload.
    """
    near = np.arange(len(dataset)) if dataset.joints_approximate else _clusters(dataset.q)
    if len(np.unique(near)) == len(dataset):
        near = _of_one_pose(dataset)
    return numbered(np.column_stack([near, *(dataset.codes(c)[1] for c in ("setup", "tool", *READ))]))


def noise_floor(dataset: Dataset) -> float | None:
    """Return the RMS 3-D distance of repeated measurements from the mean of their pose, m; None without repeats.

    σ² = Σ |p - mean|² / Σ (n - 1) over poses with n measured points p. Poses with an outlying spread are excluded,
    because a failed measurement is not noise.
    """
    known = np.isfinite(dataset.position).all(axis=1)
    points = dataset.position[known]
    code, count = np.unique(replicates(dataset)[known], return_inverse=True, return_counts=True)[1:]
    again = count > 1
    if not again.any():
        return None
    mean = np.zeros((len(count), 3))
    np.add.at(mean, code, points)
    squares = np.bincount(code, np.sum((points - (mean / count[:, None])[code]) ** 2, axis=1))[again]
    freedom = count[again] - 1
    spread = np.sqrt(squares / freedom)
    near = spread <= outlier_limit(spread)
    return float(np.sqrt(squares[near].sum() / freedom[near].sum()))


DRIFTING = 1e-3
"""Probability of a correlation of repeats with their distance in rows, below which the repeats drift."""
MOST_REPEATS = 2000
"""Largest number of rows in which a drift of repeats is sought: two million pairs of one pose."""


def repeats_drift(dataset: Dataset) -> bool:
    """Return whether repeats of a pose differ more the more rows are between them, so that they are no noise.

    Spearman's rank correlation of |p_i - p_k| and |i - k| over pairs of repeats, with Student's t of as many degrees of
    freedom as there are repeats, Σ (n - 1), less two.
    """
    rows = np.flatnonzero(np.isfinite(dataset.position).all(axis=1))[:MOST_REPEATS]
    poses = numbered(replicates(dataset)[rows][:, None])
    order = np.argsort(poses, kind="stable")
    pairs = [np.column_stack([order[: -k or None], order[k:]]) for k in range(1, np.bincount(poses, minlength=1).max())]
    first, second = np.concatenate(
        [p[poses[p[:, 0]] == poses[p[:, 1]]] for p in pairs] or [np.zeros((0, 2), np.int64)]
    ).T
    freedom = len(rows) - len(np.unique(poses)) - 2
    if freedom < 1:
        return False
    points, at = dataset.position[rows], dataset.row[rows]
    ranks = np.array(
        [_ranks(np.linalg.norm(points[second] - points[first], axis=1)), _ranks(np.abs(at[second] - at[first]))]
    )
    if (np.ptp(ranks, axis=1) == 0).any():
        return False
    rho = float(np.corrcoef(ranks)[0, 1])
    ratio = rho**2 * freedom / max(1.0 - rho**2, np.finfo(float).tiny)
    return rho > 0 and chance_of_ratio(ratio, 1, freedom) < 2 * DRIFTING


def _ranks(values: Array) -> Array:
    """Return the ranks of values; equal values have their mean rank."""
    place, count = np.unique(values, return_inverse=True, return_counts=True)[1:]
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1))[place])


def check_repeats(dataset: Dataset) -> None:
    """Check that repeats of a pose agree in their joint values and measured points.

    Raises InputError naming two rows with one `repeat` label whose joint values differ by more than 5 mrad or mm, or
    two repeats whose points lie farther apart than 5 cm.
    """
    first = _same_label(dataset, "repeat")
    apart = np.abs(dataset.q - dataset.q[first])
    if not dataset.joints_approximate and apart.max(initial=0.0) > FAR_JOINT:
        row, joint = np.unravel_index(int(np.argmax(apart)), apart.shape)
        raise InputError(
            f"{dataset.source}: rows {dataset.row[first[row]]} and {dataset.row[row]} have the same repeat label "
            f"'{dataset.label('repeat')[row]}', but {dataset.joints[joint]} differs by {apart[row, joint]:.3g} rad "
            "or m; expected another label for another pose"
        )
    _, first, code = np.unique(replicates(dataset), return_index=True, return_inverse=True)
    distance = np.nan_to_num(np.linalg.norm(dataset.position - dataset.position[first[code]], axis=1))
    if distance.max(initial=0.0) > FAR_POINT and len(np.unique(first)) > 1:
        far = int(np.argmax(distance))
        raise InputError(
            f"{dataset.source}: rows {dataset.row[first[code][far]]} and {dataset.row[far]} are one pose, but their "
            f"points lie {1e3 * distance[far]:.0f} mm apart; expected repeats, or another set-up or tool"
        )


def _same_label(dataset: Dataset, column: str, most: float = np.inf) -> IntArray:
    """Return for each row the number of the first row with equal text in a column.
    A row keeps its own number if its text is empty or stands in more than `most` rows."""
    labels = dataset.label(column)
    _, first, code, count = np.unique(labels, return_index=True, return_inverse=True, return_counts=True)
    return np.where((labels == "") | (count[code] > most), np.arange(len(labels)), first[code]).astype(np.int64)


def _same_joints(q: Array) -> IntArray:
    """Return for each row the number of the first row of its pose: the earliest row within 0.5 mrad or mm.

    Rows are compared with the first row of a pose, not with the neighbouring row, so that a slow motion is not one
    pose.
    """
    _, first, code = np.unique(q, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # one of each group of equal rows, since the tree is slow for equal points
    distinct = q[first[order]]
    tree = cKDTree(distinct)
    nearest = tree.query(distinct, k=2, p=np.inf, distance_upper_bound=np.nextafter(SAME_JOINT, 1.0))[0][:, 1]
    close = np.flatnonzero(np.isfinite(nearest))
    out = np.arange(len(distinct))
    out[close] = -1
    for row in close:
        if out[row] < 0:
            near = np.array(tree.query_ball_point(distinct[row], SAME_JOINT, p=np.inf))
            out[near[out[near] < 0]] = row
    return np.asarray(first[order][out][np.argsort(order)[code.reshape(-1)]], dtype=np.int64)


def _clusters(q: Array) -> IntArray:
    """Return for each row the number of the first row of its cluster of poses, or its own number without clusters.

    Joint values are scaled by their ranges; r is five times the median distance of a pose to the nearest pose.
    Poses lie in clusters if hardly more pairs of poses lie within 2 r than within r. For poses along a line, the number
    of pairs doubles. Poses linked by steps of at most r form a cluster. If one cluster has more than half of all poses,
    poses count as unclustered. Repeats of a pose count as one pose.
    """
    own, first = np.arange(len(q)), _same_joints(q)
    span = np.ptp(q, axis=0) if len(q) else np.zeros(0)
    distinct = np.unique(first)
    if len(distinct) < FEWEST_POSES or not (span > SAME_JOINT).any():
        return own
    places = (q[:, span > SAME_JOINT] / span[span > SAME_JOINT])[distinct]
    tree = cKDTree(places)
    near = NEAR * float(np.median(tree.query(places, k=2)[0][:, 1]))
    for some in (places[:: max(1, len(places) // SAMPLE)], places):
        within, farther = (tree.query_ball_point(some, r, return_length=True) - 1 for r in (near, 2 * near))
        if within.max() >= 0.5 * len(places) or farther.sum() > HARDLY_MORE * within.sum():
            return own
    pairs = tree.query_pairs(near, output_type="ndarray").T
    links = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(len(places), len(places)))
    together: IntArray = connected_components(links, directed=False)[1]
    if np.bincount(together).max() > 0.5 * len(places):
        return own
    leader = np.unique(together, return_index=True)[1]
    return distinct[leader[together]][np.searchsorted(distinct, first)]


def copies(dataset: Dataset) -> Mask:
    """Return a mask of rows that repeat joint values and measurement of an earlier row to the last digit."""
    return original(dataset) < np.arange(len(dataset))


def original(dataset: Dataset) -> IntArray:
    """Return for each row the first row with equal joint values, labels and measurement, to the last digit.
    A row without measured values gets its own number."""
    read = (*dataset.distances.values(), *dataset.readings.values())
    measured = np.column_stack([dataset.position, dataset.rotation, *read])
    labels = [dataset.codes(column)[1] for column in ("tool", *READ)]
    said = np.nan_to_num(np.column_stack([dataset.q, *labels, measured]), nan=np.inf)
    _, first, code = np.unique(said, axis=0, return_index=True, return_inverse=True)
    known = np.isfinite(measured).any(axis=1)
    return np.where(known, first[code.reshape(-1)], np.arange(len(dataset))).astype(np.int64)


def _renumbered(codes: IntArray, order: IntArray) -> IntArray:
    """Renumber the codes of rows from 0, in order of first appearance along a given order of the rows."""
    _, first, code = np.unique(codes[order], return_index=True, return_inverse=True)
    out = np.empty(len(codes), dtype=np.int64)
    out[order] = np.argsort(np.argsort(first))[code]
    return out


FEWEST_HELD, USUAL = 5, 0.3
"""Least number and usual share of held-out poses. With fewer than five held-out poses, the p-value of a test exceeds 3
% even if all poses improve."""

FOLDS = 5
"""Number of folds of a cross-validation that repeats a whole fit or search. A fit without one of five folds uses 80 %
of the poses (Hastie et al. 2009, 7.10)."""

FOLD_SEED = 0
"""Random seed of every split, fold and permutation that tests a search. Held-out poses therefore do not depend on the
user's seed of the search (experiments/seeds)."""


def hold_out(dataset: Dataset, fraction: float, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Return the numbers of training rows and of held-out rows of a table, both sorted; blocks are not split.

    fraction: share of the poses to hold out, approximately.
    Raises InputError if all poses are one block, or if `fraction` leaves no training rows or too few held-out rows.
    """
    if not 0.0 < fraction < 1.0:
        raise InputError(f"{fraction}, expected a share above 0 and below 1, as in 0.3", "holdout")
    of_pose = repeat_blocks(dataset)
    order = rng.permutation(of_pose.max() + 1)
    sizes = np.bincount(of_pose)[order]
    held = order[: int(np.searchsorted(np.cumsum(sizes), fraction * len(dataset), side="left")) + 1]
    mask = np.isin(of_pose, held)
    if len(order) < 2:
        raise InputError(f"{dataset.source}: no poses can be held out; expected at least 2 groups of poses")
    usual = min(FEWEST_HELD, int(USUAL * len(dataset)))
    if mask.sum() < usual:
        raise InputError(
            f"{fraction:g} of {len(dataset)} poses holds out {int(mask.sum())}, too few for a test; "
            "expected at least "
            f"{FEWEST_HELD}, as with {np.ceil(100 * FEWEST_HELD / len(dataset)) / 100:g}",
            "holdout",
        )
    if mask.all():
        groups = "" if len(order) == len(dataset) else f" in {len(order)} groups"
        raise InputError(
            f"{fraction:g} of {len(dataset)} poses{groups} leaves none to train on; expected less, as in 0.3", "holdout"
        )
    return np.flatnonzero(~mask), np.flatnonzero(mask)


def folds(dataset: Dataset, count: int, rng: np.random.Generator) -> IntArray:
    """Return the cross-validation fold of each row; blocks of rows are not split, folds have nearly equal size."""
    of_pose = repeat_blocks(dataset)
    n = int(of_pose.max()) + 1
    fold_of_block: NDArray[np.int64] = np.empty(n, dtype=np.int64)
    fold_of_block[rng.permutation(n)] = np.arange(n) % min(count, n)
    return fold_of_block[of_pose]


def stretches(row: Array, count: int) -> IntArray:
    """Divide row numbers into `count` nearly equal stretches; return the index of each row's stretch."""
    place = np.argsort(np.argsort(row, kind="stable"), kind="stable")
    return (place * count // len(row)).astype(np.int64)
