"""Identifiable parameters among the thirty: two reductions of the Jacobian, by SVD and by order.

Columns are of position only, scaled to unit norm. Parameters that coincide with a joint angle (10, 17, 24) are no
candidates. Source: Robertson (2003), Figure 3.15, Table 3.2.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.numerics import rank as ident
from gpmodel.planning.poses import spread_poses
from joints.budget import thesis_columns
from joints.passive_joint import THESIS_PARAMETERS, PassiveJoint, parameter

CONDITION_LIMIT = 50.0
REQUIRED = (1, 2, 3, 4, 5, 6, 25, 26, 27)
COINCIDENT = (10, 17, 24)
NEW = 1e-3


@dataclass(frozen=True)
class Reduction:
    """kept: thesis indices. condition: of their scaled columns. explained: dropped index -> kept ones it repeats."""

    kept: tuple[int, ...]
    condition: float
    explained: dict[int, tuple[int, ...]]


def condition_number(columns: Array) -> float:
    """Largest over smallest singular value of columns scaled to unit norm; infinite with a zero column."""
    norms = np.linalg.norm(columns, axis=0)
    if not columns.size or norms.min() <= ident.NEGLIGIBLE:
        return np.inf
    s = np.linalg.svd(columns / norms, compute_uv=False)
    return float(s[0] / s[-1]) if s[-1] > 0 else np.inf


def reduce_in_order(columns: Array, required: Sequence[int] = REQUIRED) -> Reduction:
    """Keep, in the order required first and then by index, what the columns before do not explain.

    A column is new when more than NEW of its scaled length is left after removing the kept ones. Deterministic.
    """
    order = [*required, *(p.index for p in THESIS_PARAMETERS if p.index not in (*required, *COINCIDENT))]
    kept: list[int] = []
    for index in order:
        column = columns[:, [index - 1]]
        norm = float(np.linalg.norm(column))
        if norm <= ident.NEGLIGIBLE:
            continue
        if np.linalg.norm(ident.remove(ident.orthonormal(_take(columns, kept)), column / norm)) > NEW:
            kept.append(index)
    return _reduction(columns, sorted(kept))


def reduce_by_svd(
    columns: Array, rng: np.random.Generator, limit: float = CONDITION_LIMIT, required: Sequence[int] = REQUIRED
) -> Reduction:
    """Drop one parameter at a time until the condition number is under `limit`: the thesis' procedure.

    Each time the right singular vector of the smallest singular value is read: of the parameters that may go and weigh
    in it as much as the heaviest (within 10 %), one drawn by `rng` goes. Raises InputError where only required
    parameters are left above the limit.
    """
    norms = np.linalg.norm(columns, axis=0)
    alive = [p.index for p in THESIS_PARAMETERS if norms[p.index - 1] > ident.NEGLIGIBLE]
    kept = [i for i in alive if i not in COINCIDENT]
    while condition_number(_take(columns, kept)) > limit:
        scaled = _take(columns, kept) / norms[[i - 1 for i in kept]]
        weakest = np.abs(np.linalg.svd(scaled, full_matrices=False)[2][-1])
        weakest[[i in required for i in kept]] = 0.0
        if weakest.max(initial=0.0) < 1e-6:
            raise InputError(
                f"condition limit {limit:g}: the base and the tooling ball alone exceed it; expected a tooling ball "
                f"farther off the yaw axis, more varied poses or a higher limit"
            )
        near = np.flatnonzero(weakest > 0.9 * weakest.max())
        kept.pop(int(rng.choice(near)))
    return _reduction(columns, kept)


def _take(columns: Array, indices: Sequence[int]) -> Array:
    return columns[:, [i - 1 for i in indices]]


def _reduction(columns: Array, kept: Sequence[int]) -> Reduction:
    explained = {}
    basis = _take(columns, kept)
    norms = np.linalg.norm(basis, axis=0)
    for p in THESIS_PARAMETERS:
        column = columns[:, p.index - 1]
        size = np.linalg.norm(column)
        if p.index not in kept and size > ident.NEGLIGIBLE:
            weights = np.linalg.lstsq(basis / norms, column / size, rcond=None)[0]
            explained[p.index] = tuple(i for i, w in zip(kept, weights, strict=True) if abs(w) > 0.05)
    return Reduction(tuple(kept), condition_number(basis), explained)


def most_common_reduction(
    joint: PassiveJoint,
    rng: np.random.Generator,
    *,
    trials: int = 20,
    poses: int = 100,
    limit: float = CONDITION_LIMIT,
    required: Sequence[int] = REQUIRED,
) -> tuple[Reduction, Counter[tuple[int, ...]]]:
    """The most frequent answer of the SVD reduction over fresh pose sets, and how often each answer came."""
    found = [
        reduce_by_svd(thesis_columns(joint, spread_poses(joint, poses, rng)), rng, limit, required)
        for _ in range(trials)
    ]
    counts = Counter(r.kept for r in found)
    best = counts.most_common(1)[0][0]
    return min((r for r in found if r.kept == best), key=lambda r: r.condition), counts


def observable_in_words(joint: PassiveJoint, q: Array) -> str:
    """Describe the parameters that positions alone determine without known angles, at poses q (N, 3)."""
    columns = thesis_columns(joint, q, angles_known=False)
    reduction = reduce_in_order(columns, required=(1, 2, 3, 27, 15))
    offsets = [i for i in reduction.kept if i not in (1, 2, 3, 25, 26, 27)]
    named = ", ".join(f"{parameter(i).axis} of {parameter(i).frame} (index {i})" for i in offsets)
    gone = [p.index for p in THESIS_PARAMETERS if not np.any(np.abs(columns[:, p.index - 1]) > ident.NEGLIGIBLE)]
    return (
        f"With free angles every pose leaves one equation, along its radius. {len(reduction.kept)} combinations are "
        f"observable: the centre (3), the radius (1), and {named or 'no axis offset'}. "
        f"Parameters {', '.join(map(str, gone))} move the tooling ball on its sphere only: the angles absorb them."
    )
