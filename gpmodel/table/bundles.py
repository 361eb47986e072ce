"""Rows that say the same thing again: repeats of a pose, and groups that belong together."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.table.dataset import READ, TOUCHED, Dataset

SAME_JOINT = 5e-4
"""Largest difference of joint values of one pose, rad or m: the last digit of a controller's display (0.01 deg) and the
motion of a servo at rest (0.02 deg)."""

NEAR = 5.0
"""Largest distance of poses in a cluster, over the median distance to the nearest pose. Of ten or twenty poses in a
small box it is three to five; poses spread over a workspace have no such gap."""

HARDLY_MORE = 1.5
"""Growth of the number of pairs when their distance doubles, below which poses lie in clusters: one in clusters, two
along a line."""

FAR_JOINT = 10 * SAME_JOINT
"""Difference of joint values, rad or m, beyond which rows with one label are no repeats: 0.3 deg moves a tool by
millimetres."""

FAR_POINT = 0.05
"""Distance of the points of one pose, m, beyond which they are no repeats: no play or slip is as large."""

FEWEST_POSES = 20
"""Least number of poses for clusters: with fewer, a gap between their distances is chance."""

FEW_TOUCHES = 12
"""Touches of one surface, point or bar up to which all are needed to locate it. Of more, any half suffices."""

SAMPLE = 50
"""Poses compared first, so that thousands of poses without clusters are not all compared."""


def bundles(dataset: Dataset) -> IntArray:
    """Bundle code (N,) of every row, 0 to B - 1: rows of one code share more than the model, so no split parts them.

    Together are rows with the same `group`, with the same `repeat`, that touched one point, bar or a surface that was
    touched FEW_TOUCHES times at most, and rows whose joint values all agree within SAME_JOINT or lie in one cluster,
    whatever the set-up or payload. Codes are in the order of the joint values: the order of the rows does not matter.
    """
    links = [_same_label(dataset, column) for column in ("group", "repeat")]
    links += [_same_label(dataset, column, FEW_TOUCHES) for column in TOUCHED if column in dataset.labels]
    links += [_same_joints(dataset.q), _clusters(dataset.q)]
    n = len(dataset)
    rows = np.concatenate([np.arange(n)] * len(links))
    graph = coo_array((np.ones(len(rows)), (rows, np.concatenate(links))), shape=(n, n))
    together = connected_components(graph, directed=False)[1]
    return _renumbered(together, np.lexsort(np.round(np.column_stack([dataset.q, dataset.payload]), 9).T[::-1]))


def replicates(dataset: Dataset, whatever: bool = False) -> IntArray:
    """Code (N,) of every row: rows of one code read the same at the same pose, payload, set-up and tool; or whatever
    they read, in whichever set-up.

    A `repeat` label decides where there is one; elsewhere joint values within SAME_JOINT, unless they are
    approximate. Rows that copy the measurement of another are not counted as measured again: they are alone.
    """
    read = () if whatever else ("setup", "tool", *READ)
    keys = np.column_stack([_of_one_pose(dataset, whatever), *(dataset.codes(c)[1] for c in read)])
    loads = np.unique(np.round(dataset.payload, 9), return_inverse=True)[1]
    return numbered(np.column_stack([keys, loads]))


def _of_one_pose(dataset: Dataset, whatever: bool = False) -> IntArray:
    """Code (N,) of every row, of its label or its joint values; copies are alone, or of the pose they copy."""
    labels = dataset.label("repeat")
    same = np.arange(len(dataset)) if dataset.joints_approximate else _same_joints(dataset.q)
    if not whatever:
        again = np.flatnonzero(copies(dataset))
        same[again] = again
    return numbered(np.column_stack([np.where(labels != "", _same_label(dataset, "repeat"), same), labels != ""]))


def numbered(keys: Array | IntArray) -> IntArray:
    """Code (N,) of every row of keys (N, K), the same where all keys are."""
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def different_poses(dataset: Dataset) -> int:
    """Return the number of different poses: fewer than rows if poses are repeated or have several markers."""
    return int(replicates(dataset, whatever=True).max(initial=-1)) + 1


def different_readings(dataset: Dataset) -> Dataset:
    """The first row of everything that was read at each pose: no repeats, no copies."""
    once = dataset.subset(~copies(dataset))
    return once.subset(np.sort(np.unique(replicates(once), return_index=True)[1]))


def sharing(dataset: Dataset) -> IntArray:
    """Code (N,) of every row: rows of one code may share a deviation that no model explains.

    Of one pose, whatever the payload, or where poses lie in clusters in one of these; with the same set-up and tool.
    """
    near = np.arange(len(dataset)) if dataset.joints_approximate else _clusters(dataset.q)
    if len(np.unique(near)) == len(dataset):
        near = _of_one_pose(dataset)
    return numbered(np.column_stack([near, *(dataset.codes(c)[1] for c in ("setup", "tool", *READ))]))


def noise_floor(dataset: Dataset) -> float | None:
    """RMS 3-D distance, m, of repeated measurements from their own mean, or None without repeats.

    σ² = Σ |p - mean|² / Σ (n - 1) over poses measured n times (see `replicates`), but for those whose own spread stands
    far out: a reading that failed is no noise.
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


def check_repeats(dataset: Dataset) -> None:
    """Refuses rows labelled as repeats of one pose whose joint values differ by more than FAR_JOINT, and repeats of
    either kind whose points lie farther apart than FAR_POINT.

    Raises InputError naming the two rows, and the joint or the distance.
    """
    first = _same_label(dataset, "repeat")
    apart = np.abs(dataset.q - dataset.q[first])
    if not dataset.joints_approximate and apart.max(initial=0.0) > FAR_JOINT:
        row, joint = np.unravel_index(int(np.argmax(apart)), apart.shape)
        raise InputError(
            f"{dataset.source}: rows {dataset.row[first[row]]} and {dataset.row[row]} are both repeat "
            f"'{dataset.label('repeat')[row]}', but {dataset.joints[joint]} differs by {apart[row, joint]:.3g} rad "
            "or m; expected one label a pose"
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
    """First row (N,) with the same text in a column; rows without text, or with one of more rows than `most`, are
    alone."""
    labels = dataset.label(column)
    _, first, code, count = np.unique(labels, return_index=True, return_inverse=True, return_counts=True)
    return np.where((labels == "") | (count[code] > most), np.arange(len(labels)), first[code]).astype(np.int64)


def _same_joints(q: Array) -> IntArray:
    """First row (N,) of each pose: a row joins the earliest unjoined one within SAME_JOINT in every joint.

    Rows are compared with the first of their pose, not with their neighbours, so that a slow motion does not become
    one pose.
    """
    _, first, code = np.unique(q, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # equal rows stand for one another: the tree is slow among them
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
    """First row (N,) of each cluster of neighbouring poses; every row alone where poses do not lie in clusters.

    With joints over their ranges and r = NEAR times the median distance of a pose to the next: clusters are there where
    within 2 r lie hardly more pairs of poses than within r; along a line there are twice as many, and more where poses
    fill anything. A cluster is what is linked by steps of at most r, so that two that lie close are one; with half of
    all poses in one there are none. Repeats of a pose count as one.
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
    """Rows (N,) whose joint values and measurement are, to the last digit, those of an earlier row."""
    return original(dataset) < np.arange(len(dataset))


def original(dataset: Dataset) -> IntArray:
    """First row (N,) with the same joint values, labels of what it reads and measurement to the last digit; itself
    where nothing was measured in columns."""
    read = (*dataset.distances.values(), *dataset.readings.values())
    measured = np.column_stack([dataset.position, dataset.rotation, *read])
    labels = [dataset.codes(column)[1] for column in ("tool", *READ)]
    said = np.nan_to_num(np.column_stack([dataset.q, *labels, measured]), nan=np.inf)
    _, first, code = np.unique(said, axis=0, return_index=True, return_inverse=True)
    known = np.isfinite(measured).any(axis=1)
    return np.where(known, first[code.reshape(-1)], np.arange(len(dataset))).astype(np.int64)


def _renumbered(codes: IntArray, order: IntArray) -> IntArray:
    """Renumber codes (N,) from 0 as they appear in an order of the rows."""
    _, first, code = np.unique(codes[order], return_index=True, return_inverse=True)
    out = np.empty(len(codes), dtype=np.int64)
    out[order] = np.argsort(np.argsort(first))[code]
    return out


FEWEST_HELD, USUAL = 5, 0.3
"""Least number of held-out poses, and the usual share. With fewer the p-value exceeds 3 % even if all improve."""

FOLDS = 5
"""Folds where a whole fit or search is repeated: 80 % of the poses are left to each (Hastie et al. 2009, 7.10)."""

JUDGED = 0
"""Seed of every split, fold and permutation by which a discovery is judged. It does not follow the seed of the search,
so that findings do not depend on which poses are held out (experiments/seeds)."""


def hold_out(dataset: Dataset, fraction: float, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Rows (T,) to train on and rows (H,) held out (about `fraction` of the poses, whole bundles), both sorted.

    Raises InputError where all poses are one bundle, or `fraction` leaves none to train on or hardly any held out.
    """
    if not 0.0 < fraction < 1.0:
        raise InputError(f"{fraction}, expected a share above 0 and below 1, as in 0.3", "holdout")
    of_pose = bundles(dataset)
    order = rng.permutation(of_pose.max() + 1)
    sizes = np.bincount(of_pose)[order]
    held = order[: int(np.searchsorted(np.cumsum(sizes), fraction * len(dataset), side="left")) + 1]
    mask = np.isin(of_pose, held)
    if len(order) < 2:
        raise InputError(f"{dataset.source}: no poses can be held out; expected at least 2 groups of poses")
    usual = min(FEWEST_HELD, int(USUAL * len(dataset)))
    if mask.sum() < usual:
        raise InputError(
            f"{fraction:g} of {len(dataset)} poses holds out {int(mask.sum())}, which prove nothing; expected at least "
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
    """Fold index (N,) for cross-validation, whole bundles, folds of nearly equal size."""
    of_pose = bundles(dataset)
    n = int(of_pose.max()) + 1
    fold_of_bundle: NDArray[np.int64] = np.empty(n, dtype=np.int64)
    fold_of_bundle[rng.permutation(n)] = np.arange(n) % min(count, n)
    return fold_of_bundle[of_pose]


def stretches(row: Array, count: int) -> IntArray:
    """Code (N,) of the stretch that each value of `row` (N,) lies in, of `count` with nearly equally many."""
    place = np.argsort(np.argsort(row, kind="stable"), kind="stable")
    return (place * count // len(row)).astype(np.int64)
