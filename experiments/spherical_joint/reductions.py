"""Which parameters of the joint are told apart by many sets of poses, and without its angles."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics import rank as ident
from gpmodel.planning.poses import spread_poses
from joints.kinematics import THESIS_PARAMETERS, parameter
from joints.passive_joint import PassiveJoint
from joints.reduction import CONDITION_LIMIT, REQUIRED, Reduction, reduce_by_svd, reduce_in_order, thesis_columns


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
    """What positions alone determine when no angle is known, at poses q (N, 3)."""
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
