"""Divide the rows of a later session into two tools, if the rows were measured with two tool points.

Rows i with residual r_i have the tool displacement t_g(i), g(i) in {1, 2}:  r_i = F_i ρ + K_i t_g(i) + noise. The
division of the rows alternates between least squares for ρ, t_1, t_2 and the better tool for each row (classification
EM; Celeux and Govaert 1992), from several initial divisions, or one tool follows the other. The division of n rows
costs n ln 2 nats, and ln n nats if one tool follows the other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gpmodel import wording
from gpmodel.application.possible_changes import log_likelihood
from gpmodel.application.recheck import Recheck, Session, recheck, settled
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import linearise
from gpmodel.mechanism.protocol import AXES

MOST_STEPS = 50
"""Largest number of steps of one division. A division of 400 rows converges in less than ten."""
FEWEST = 2
"""Least number of rows of a tool that are no outliers: any single row fits a tool of its own."""
MOST_CHANGES = 200
"""Number of evenly spaced rows of a long table after which a change of the tool is tested."""
TOOLS_MOVED = 2
"""Number of Gauss-Newton fits between divisions. The registration of the first fit is that of one tool."""


@dataclass(frozen=True)
class TwoTools:
    """Later session whose rows divide into two tools.

    second: mask of the rows with the second tool. names: labels of the first and of the second tool.
    """

    found: Recheck
    second: Mask
    names: tuple[str, str]

    @property
    def title(self) -> str:
        """Name of the change of the tool: the row after which the tool changed, or the rows of the second tool."""
        rows = self.found.session.poses.dataset.row
        if _in_sequence(self.second):
            return f"tool changed after row {rows[np.flatnonzero(np.diff(self.second))[0]]}: tool point"
        own = rows[self.second].tolist()
        return f"two tools in one table: the tool point of {len(own)} rows ({wording.some(own)}) differs"


def two_tools(near: Recheck, limit: float) -> TwoTools | None:
    """Return the later session with its rows divided into two tools; None if one tool is more probable.

    limit: displacement of a tool from the model's tool point, m, up to which the tool point is not fitted again.
    """
    session = near.session
    (label, *others) = session.saved.placement.tool
    if others or len(session.use) < 2 * len(AXES):
        return None
    names = label, f"{label} (second)".strip()
    second = np.zeros(len(session.use), dtype=bool)
    for _ in range(TOOLS_MOVED):
        second = _divided(session, names, second)
        if not second.any() or second.all():
            return None
        session = _settled(near.session, names, second, frozenset(names))
    model = session.fitted.tool[label]
    off = [float(np.linalg.norm((session.saved.placement.tool[n] - model)[:3, 3])) for n in names]
    if off[1] < off[0]:
        second = ~second
    again = names[1:] if min(off) < limit else names
    found = recheck(_settled(near.session, names, second, frozenset(again)))
    if min(np.count_nonzero(found.session.use[part]) for part in (second, ~second)) < FEWEST:
        return None
    one = recheck(replace(near.session, use=found.session.use))
    gain = log_likelihood(one, one.chi_square - found.chi_square) - log_likelihood(one)
    price = _price(second) + 0.5 * (found.basis.shape[1] - one.basis.shape[1]) * np.log(one.degrees)
    return TwoTools(found, second, names) if gain > price else None


def _price(second: Mask) -> float:
    """Return the logarithm of the number of possible divisions of the rows, nats."""
    return float(np.log(len(second)) if _in_sequence(second) else len(second) * np.log(2.0))


def _in_sequence(second: Mask) -> bool:
    return bool(np.count_nonzero(np.diff(second)) == 1)


def _settled(before: Session, names: tuple[str, str], second: Mask, again: frozenset[str]) -> Session:
    """Fit registration and the tools `again` of a session with divided rows; other tools keep the model's point."""
    saved, dataset = before.saved, before.poses.dataset
    labels = {**dataset.labels, "tool": np.where(second, names[1], names[0])}
    tools = dict.fromkeys(names, before.fitted.tool[names[0]])
    fitted, start = (replace(placement, tool=tools) for placement in (before.fitted, saved.placement))
    return settled(replace(saved, placement=fitted), replace(dataset, labels=labels), start, again)


def _divided(session: Session, names: tuple[str, str], second: Mask) -> Mask:
    """Return the mask of the rows with the second tool that has the least sum of squares over initial divisions."""
    saved, poses = session.saved, session.poses
    everything = np.ones(len(poses), dtype=bool)
    problem = linearise(saved.model, poses, saved.theta, saved.placement, saved.weights, everything)
    placed = [k for k, name in enumerate(problem.placement_names) if name.startswith("registration")]
    tools = [f"tool {n}".rstrip() for n in names if n in saved.placement.tool]
    lever = np.sum(
        [problem.columns[:, [problem.placement_names.index(f"{t} {a}") for a in AXES[:3]]] for t in tools], 0
    )
    left, pose = problem.residual.copy(), problem.pose_of_row
    for name, frame in saved.placement.tool.items():
        off = frame[:3, :3].T @ (frame - session.fitted.tool[names[0]])[:3, 3]
        left += lever @ off * (poses.dataset.label("tool") == name)[pose]
    columns = problem.columns[:, placed]
    starts = [second] if second.any() else list(_starts(lever, left, pose))
    tried = [_alternated(columns, lever, left, pose, start) for start in starts]
    tried += [_fit(columns, lever, left, pose, ordered)[1:] for ordered in _sequences(len(poses))]
    return min(tried, key=lambda one: 0.5 * len(left) * np.log(max(one[0], np.finfo(float).tiny)) + _price(one[1]))[1]


def _starts(lever: Array, left: Array, pose: IntArray) -> Iterator[Mask]:
    """Yield initial divisions: signs of the tool displacement of each row along its principal axes."""
    own = np.stack([np.bincount(pose, column * left) for column in lever.T], axis=1)
    own -= np.median(own, axis=0)
    for axis in np.linalg.svd(own, full_matrices=False)[2]:
        yield np.asarray(own @ axis > 0.0)


def _sequences(count: int) -> Iterator[Mask]:
    """Yield divisions of the rows in which the second tool follows the first."""
    for first in range(FEWEST - 1, count - FEWEST + 2, max(1, count // MOST_CHANGES)):
        yield np.arange(count) >= first


def _alternated(placed: Array, lever: Array, left: Array, pose: IntArray, second: Mask) -> tuple[float, Mask]:
    """Return the sum of squares and the division after alternating between least squares and the better tool."""
    for _ in range(MOST_STEPS):
        better, total, _ = _fit(placed, lever, left, pose, second)
        if (better == second).all():
            break
        second = better
    return total, second


def _fit(placed: Array, lever: Array, left: Array, pose: IntArray, second: Mask) -> tuple[Mask, float, Mask]:
    """Fit registration and both tools by least squares; return the mask of the rows that the second tool fits better,
    the sum of squares and the division of the rows."""
    of_second = second[pose][:, None]
    step = np.linalg.lstsq(np.hstack([placed, lever * ~of_second, lever * of_second]), left, rcond=1e-12)[0]
    rest = left - placed @ step[:-6]
    squares = [np.bincount(pose, (rest - lever @ tool) ** 2) for tool in (step[-6:-3], step[-3:])]
    return np.asarray(squares[1] < squares[0]), float(np.where(second, *squares[::-1]).sum()), second
