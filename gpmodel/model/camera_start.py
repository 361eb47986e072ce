"""Where a camera and a board are, in closed form: homographies, poses of the views, hand-eye.

Sources: Zhang (2000), a lens from homographies; Lu, Hager and Mjolsness (2000), a body's pose by orthogonal iteration;
Shah (2013), A B = C T by Kronecker products.
"""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.numerics import se3

REWEIGHTED = 10
"""Fits of a homography, a body's pose or hand and eye, each with less weight on what stands far out of the one
before."""
IN_TURN = 20
"""Steps of a body's pose between them."""
TURNING = 1e-3
"""Smallest ratio of the second smallest singular value to the largest; below it all views turn about one axis."""
FEWEST_VIEWS = 3
"""Between them two turns, about two axes: fewer leave a hand-eye transform open."""


def homography(flat: Array, seen: Array) -> Array:
    """H (3, 3) with [x, y, 1] ~ H [X, Y, 1], of flat (C, 2), m, and seen (C, 2), reweighted against wrong corners."""
    ones = np.ones(len(flat))
    (board, a), (image, b) = _normalised(flat), _normalised(seen)
    source, weight = np.column_stack([board, ones]), ones.copy()
    for _ in range(REWEIGHTED):
        rows = np.zeros((2 * len(flat), 9))
        rows[::2, :3], rows[::2, 6:] = source, -image[:, :1] * source
        rows[1::2, 3:6], rows[1::2, 6:] = source, -image[:, 1:] * source
        h = np.linalg.svd(rows * np.repeat(weight, 2)[:, None])[2][-1].reshape(3, 3)
        mapped = source @ h.T
        off = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - image, axis=1)
        weight = _trusted(off)
    out = np.linalg.solve(b, h @ a)
    return out / float(np.linalg.norm(out))


def _normalised(points: Array) -> tuple[Array, Array]:
    """Points (C, 2) about zero, of size one, and the map (3, 3) that made them so."""
    middle, size = points.mean(axis=0), points.std() or 1.0
    scale = np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1.0]])
    return (points - middle) / size, scale


def lens_from(homographies: list[Array]) -> Array:
    """fx, fy, cx, cy (4,), px, of homographies from the board to pixels, without skew."""

    def row(h: Array, i: int, j: int) -> Array:
        a, b = h[:, i], h[:, j]
        return np.array([a[0] * b[0], a[1] * b[1], a[2] * b[0] + a[0] * b[2], a[2] * b[1] + a[1] * b[2], a[2] * b[2]])

    scale = np.diag([1e-3, 1e-3, 1.0])
    system = [r for h in (scale @ h for h in homographies) for r in (row(h, 0, 1), row(h, 0, 0) - row(h, 1, 1))]
    b11, b22, b13, b23, b33 = np.linalg.svd(np.array(system))[2][-1]
    cx, cy = -b13 / b11, -b23 / b22
    size = b33 - b13**2 / b11 - b23**2 / b22
    if size / b11 <= 0 or size / b22 <= 0:
        raise InputError("its views do not say its focal length; expected the board tilted in several directions")
    return 1e3 * np.array([np.sqrt(size / b11), np.sqrt(size / b22), cx, cy])


def flattened(board: Array) -> tuple[Array, Array]:
    """A frame (4, 4) in which the points (P, 3) of a board lie in z = 0, and how far off it they are (P,)."""
    middle = board.mean(axis=0)
    axes = np.linalg.svd(board - middle, full_matrices=False)[2]
    out = se3.frame(np.column_stack([axes[0], axes[1], np.cross(axes[0], axes[1])]), middle)
    return out, np.abs((board - middle) @ out[:3, 2])


def view_pose(board: Array, seen: Array, plane: Array | None) -> Array:
    """The board in the camera's frame (4, 4): its corners (C, 3), m, and their directions (C, 2).

    plane: frame of a flat board's plane, as `flattened`; None of a body.
    """
    if plane is None:
        return _body_pose(board, seen)
    flat = (board - plane[:3, 3]) @ plane[:3, :2]
    h = homography(flat, seen)
    h = h / np.linalg.norm(h[:, 0]) * (np.sign(h[2, 2]) or 1.0)
    rough = np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])])
    place = h[:, 2] / np.mean(np.linalg.norm(h[:, :2], axis=0))
    return se3.frame(se3.nearest_rotation(rough), place) @ np.linalg.inv(plane)


def _body_pose(body: Array, seen: Array) -> Array:
    """Estimate the pose of a body whose points are not in one plane.

    Starts from weak perspective, then alternates: t fits the lines of sight given R, R fits the nearest points on
    them. Each step is reweighted against wrong points.
    """
    sight = np.column_stack([seen, np.ones(len(seen))])
    onto = sight[:, :, None] * sight[:, None, :] / np.sum(sight**2, axis=1)[:, None, None]
    weight = np.ones(len(body))

    def turned_onto(target: Array) -> Array:
        middle, there = weight @ body / weight.sum(), weight @ target / weight.sum()
        return se3.nearest_rotation((weight[:, None] * (target - there)).T @ (body - middle))

    turn = turned_onto(sight)
    for _ in range(REWEIGHTED):
        for _ in range(IN_TURN):
            turned = body @ turn.T
            away = np.einsum("n,nij,nj->i", weight, onto - np.eye(3), turned)
            shift = np.linalg.solve(np.einsum("n,nij->ij", weight, np.eye(3) - onto), away)
            near = np.einsum("nij,nj->ni", onto, turned + shift)
            turn = turned_onto(near)
        placed = body @ turn.T + shift
        off = np.linalg.norm(placed[:, :2] / placed[:, 2:] - seen, axis=1)
        weight = _trusted(off)
    return se3.frame(turn, shift)


def hand_eye(moved: Array, seen: Array) -> tuple[Array, Array]:
    """B and C (4, 4) with A B = C T: moved A (V, 4, 4), the board's carrier in the camera's; seen T (V, 4, 4).

    Raises InputError where too few views, or all about one axis, leave them open.
    """
    if len(moved) < FEWEST_VIEWS:
        raise InputError(f"{len(moved)} poses; expected at least {FEWEST_VIEWS}")
    eye, weight = np.eye(3), np.ones(len(moved))
    for _ in range(REWEIGHTED):
        rows = [
            w * np.hstack([np.kron(a, eye), -np.kron(eye, t.T)])
            for w, a, t in zip(weight, moved[:, :3, :3], seen[:, :3, :3], strict=True)
        ]
        _, size, vt = np.linalg.svd(np.vstack(rows))
        if size[-2] < TURNING * size[0]:
            raise InputError("the board turns about one axis only; expected poses that turn it about two more")
        sign = np.sign(np.linalg.det(vt[-1][:9].reshape(3, 3)))
        turn, eye_turn = [se3.nearest_rotation(sign * vt[-1][k : k + 9].reshape(3, 3)) for k in (0, 9)]
        off = np.linalg.norm(moved[:, :3, :3] @ turn - eye_turn @ seen[:, :3, :3], axis=(1, 2))
        weight = _trusted(off)
    system = np.concatenate([w * np.hstack([a[:3, :3], -eye]) for w, a in zip(weight, moved, strict=True)])
    right = weight[:, None] * (seen[:, :3, 3] @ eye_turn.T - moved[:, :3, 3])
    places = np.linalg.lstsq(system, right.ravel(), rcond=None)[0]
    return se3.frame(turn, places[:3]), se3.frame(eye_turn, places[3:])


def middle_of(frames: Array) -> Array:
    """The frame (4, 4) nearest to all of some (V, 4, 4): medians of their places, the mean of their turns."""
    return se3.frame(se3.nearest_rotation(frames[:, :3, :3].mean(axis=0)), np.median(frames[:, :3, 3], axis=0))


def _trusted(off: Array) -> Array:
    """Weights (C,) of what is off by so much, little of what is far beyond most."""
    return np.asarray(1.0 / (1.0 + (off / (3.0 * np.median(off) + 1e-12)) ** 2))
