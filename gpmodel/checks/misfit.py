"""Residual of registration and one tool point, or of the largest part of the positions that fits."""

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square

CLOSE = 0.01
"""Metres: a fit that leaves less is not searched from another side of the flange."""
COARSE, FINE, FINER = 0.3, 1e-3, 0.3
"""First and last scale of the robust fit, m, and the factor between two of them. Half or double of each gives the same
rows; a last scale of 0.1 mm would take errors of the geometry for bad readings."""
STEPS = 4
"""Gauss-Newton steps at each scale; eight end at the same rows."""
QUARTER, SPREAD = 0.25, 12.0
"""Quantile of the errors that is of good rows though most are bad, and times it that no good row is off: of lengths of
3-D normal errors the quarter is at 1.1 σ, and 13 σ never occur."""
SMALLEST = 5e-3
"""Metres: what is off by less is no gross error."""


def flange(mechanism: Mechanism, q: Array, scale: float = 1.0) -> Array:
    """Frames (N, 4, 4) of the flange in the root at joint values (N, n), all lengths of the mechanism times `scale`."""
    transforms = np.array(mechanism.transforms(q))
    transforms[..., :3, 3] *= scale
    return np.asarray(se3.chain(transforms)[-1])


def spread_of(points: Array) -> float:
    """RMS distance of points (N, k) from their centre."""
    return root_mean_square(np.linalg.norm(points - points.mean(axis=0), axis=1))


@dataclass(frozen=True)
class Registered:
    """Registration (turn (3, 3), shift (3,)) and tool point (3,) in the flange, m."""

    turn: Array
    shift: Array
    tool: Array

    @classmethod
    def of(cls, frames: Array, position: Array, tool: Array) -> "Registered":
        """The best registration beside a tool point."""
        return cls(*se3.fit_rotation(tips(frames, tool), position), tool)

    def points(self, frames: Array) -> Array:
        """Predicted positions (N, 3), m."""
        return np.asarray(tips(frames, self.tool) @ self.turn.T + self.shift)

    def errors(self, frames: Array, position: Array) -> Array:
        """Distance (N,), m, of measured positions from the predicted ones."""
        return np.asarray(np.linalg.norm(position - self.points(frames), axis=1))


def tips(frames: Array, tool: Array) -> Array:
    """Tool points (N, 3) in the root."""
    return np.asarray(frames[:, :3, 3] + frames[:, :3, :3] @ tool)


def registered(frames: Array, position: Array) -> Registered:
    """Least squares, searched from all sides of the flange: where it turns about one centre, a point on the wrong side
    fits best near by."""

    def residual(point: Array) -> Array:
        reached = tips(frames, point)
        turn, shift = se3.fit_rotation(reached, position)
        return np.asarray((position - reached @ turn.T - shift).ravel())

    best, tool = np.inf, np.zeros(3)
    for start in np.vstack([np.zeros(3), 0.2 * np.eye(3), -0.2 * np.eye(3)]):
        found = optimize.least_squares(residual, start, x_scale=0.1, max_nfev=12)
        if (rms := float(np.sqrt(2 * found.cost / len(position)))) < best:
            best, tool = rms, found.x
        if best < CLOSE:
            break
    return Registered.of(frames, position, tool)


def misfit(mechanism: Mechanism, q: Array, position: Array) -> float:
    """RMS distance, m, that registration and one tool point leave: q (N, n), position (N, 3)."""
    frames = flange(mechanism, q)
    return root_mean_square(registered(frames, position).errors(frames, position))


def least_misfit(frames: Array, position: Array) -> Array:
    """RMS distance (...), m, below which no registration and tool point can come: positions (..., N, 3) as any linear
    function of the positions of the flange frames (..., N, 4, 4) and of all entries of their rotations,
    p = s + A t + B vec R."""
    turns = frames[..., :3, :3].reshape(*frames.shape[:-2], 9)
    columns = np.linalg.qr(np.concatenate([np.ones_like(turns[..., :1]), frames[..., :3, 3], turns], axis=-1))[0]
    left = position - columns @ (np.swapaxes(columns, -1, -2) @ position)
    return np.asarray(np.sqrt(np.mean(np.sum(left**2, axis=-1), axis=-1)))


def core(frames: Array, position: Array) -> tuple[Registered, Mask]:
    """Registration and tool point of the largest part of the rows that fits one, and which rows (N,) are of it.

    A Cauchy loss whose scale falls from COARSE to FINE, started from the least-squares fit to all rows, to the first
    and to the last third. Source: Blake and Zisserman (1987), graduated non-convexity.
    """
    third = max(len(frames) // 3, 6)
    found = [_robust(frames, position, part) for part in (slice(None), slice(third), slice(-third, None))]
    errors = [p.errors(frames, position) for p in found]
    best = int(np.argmin([np.quantile(e, QUARTER) for e in errors]))
    return found[best], np.asarray(errors[best] <= gross(errors[best]))


def gross(errors: Array) -> float:
    """Error, m, beyond which one is gross beside the smallest quarter of the errors (N,)."""
    return max(SMALLEST, SPREAD * float(np.quantile(errors, QUARTER)))


def _robust(frames: Array, position: Array, part: slice) -> Registered:
    """Gauss-Newton with weights 1 / (1 + |r|² / scale²), one scale after the other."""
    now, scale = registered(frames[part], position[part]), COARSE
    while scale > FINE:
        for _ in range(STEPS):
            reached = tips(frames, now.tool) @ now.turn.T
            left = position - reached - now.shift
            weight = 1.0 / np.hypot(1.0, np.linalg.norm(left, axis=1) / scale)
            columns = np.concatenate(
                [-se3.hat(reached), np.broadcast_to(np.eye(3), (len(left), 3, 3)), now.turn @ frames[:, :3, :3]], axis=2
            )
            step = np.linalg.lstsq((columns * weight[:, None, None]).reshape(-1, 9), (left * weight[:, None]).ravel())[
                0
            ]
            turn = se3.exp(np.concatenate([np.zeros(3), step[:3]]))[:3, :3] @ now.turn
            now = Registered(turn, now.shift + step[3:6], now.tool + step[6:])
        scale *= FINER
    return now
