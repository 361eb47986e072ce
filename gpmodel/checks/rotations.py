"""Measured rotations that are in another convention than rotation vectors in the axes of x, y, z."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.checks.misfit import flange, registered
from gpmodel.checks.mixed_up import FAR_BETTER, FEWEST_ROWS, comparable_rows
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset

COARSE = 0.05
"""Radians, median over the poses, from which rotations are refused: three degrees, where zeros of joints are off by
milliradians."""
TAIT_BRYAN = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
PROPER = ("xyx", "xzx", "yxy", "yzy", "zxz", "zyz")


def rotations_flaw(mechanism: Mechanism, data: Dataset) -> str | None:
    """State the disagreement of rotations with the mechanism, and the convention in which they fit; None where they
    fit.

    With the registration A of the positions and the rotation B of the tool in the flange, R = A R_flange B. Without
    positions nothing is judged.
    """
    rows = comparable_rows(data)
    rows = rows[np.isfinite(data.rotation[rows]).all(axis=1)]
    if len(rows) < FEWEST_ROWS or branched(mechanism) or not all(j.measured for j in mechanism.joints):
        return None
    frames = flange(mechanism, data.q[rows])
    turned = registered(frames, data.position[rows]).turn @ frames[:, :3, :3]
    vectors = data.rotation[rows]
    now = miss(turned, Rotation.from_rotvec(vectors).as_matrix())
    if now < COARSE:
        return None
    misses = {name: miss(turned, rotations) for name, rotations in _conventions(vectors)}
    best = min(misses, key=lambda name: round(misses[name], 6))
    said = f"rx, ry, rz miss the mechanism's rotations by {np.degrees(now):.3g} deg"
    if misses[best] > min(COARSE, now / FAR_BETTER):
        return (
            f"{said}, in no convention by less than {np.degrees(misses[best]):.3g}; expected rotation vectors (axis "
            "times angle) in the axes of x, y, z, each of the pose of its row"
        )
    return (
        f"{said}; as {best} they fit to {1e3 * misses[best]:.3g} mrad: import them in that convention (gpmodel import "
        "--map, [orientation])"
    )


def miss(turned: Array, measured: Array) -> float:
    """Median angle, rad, by which measured rotations (N, 3, 3) miss A R_flange (N, 3, 3) times the best constant B."""
    relative = np.swapaxes(turned, 1, 2) @ measured
    tool = se3.nearest_rotation(relative.sum(axis=0))
    return float(np.median(np.linalg.norm(se3.rotation_vector(relative @ tool.T), axis=1)))


def _conventions(vectors: Array) -> Iterator[tuple[str, Array]]:
    """Yield the possible conventions of rotation vectors (N, 3), by name, as rotations (N, 3, 3)."""
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
