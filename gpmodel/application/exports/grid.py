"""Lookup table of joint corrections at the nodes of a box, for controllers that interpolate linearly."""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.interpolate import RegularGridInterpolator

from gpmodel.application.compensate import GIVEN, MAX_MOVE, TargetPoses, corrected
from gpmodel.application.exports.sample import Place, measured_table
from gpmodel.application.kinematics import ITERATIONS, REACHED, error_and_jacobian, solve, tips
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import at_end, usable
from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.cells import table_text
from gpmodel.table.convention import PREFIX, SENT
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import joint_column

NODES = 5
"""Number of nodes along each side of the lookup table. The interpolation error falls with the nodes' square."""

MOST_NODES = 100
"""Largest number of nodes along a side of the lookup table. A million corrections exceed the memory of every controller
and take an hour of computing."""

SIZES = (0.02, 0.03, 0.045, 0.07, 0.1, 0.15, 0.22)
"""Half sides of trial boxes of a lookup table, if none is given, relative to the spread of the measured points.
Successive trial boxes grow threefold in volume; the last trial box is half as wide as the workspace."""

PROBES, LEFT = 3, 0.2
"""Number of nodes along a side of a trial box; largest accepted error between nodes, relative to the uncorrected error.
With 5 nodes along a side (NODES) the interpolation error is a quarter of that with 3 nodes (PROBES)."""

NEAR, STEPS = 20, 5
"""Number of measured poses near the box's middle at which inverse kinematics may start; steps between two nodes."""

TRIED = 5
"""Number of measured poses around which a box of the lookup table is tried, the pose farthest from singular first."""

CHECKS, TRIALS = 1000, 200
"""Number of random points at which the interpolation error is evaluated: in the exported table, and in a trial box."""


@dataclass(frozen=True)
class Grid:
    """Lookup table. text: content of the file. error, before: distance, m, of the real tool from random commanded
    points of the box with interpolated correction, and without correction. reached: share of nodes with a correction.
    state: payload and further inputs at which the corrections hold."""

    text: str
    error: Array
    before: Array
    reached: float
    state: str = ""


def lookup_grid(saved: SavedModel, place: Place, box: Array | None, count: int, rng: np.random.Generator) -> Grid:
    """Return joint corrections on a grid of `count` nodes along each side of `box`, its corners in m in the root frame.

    Orientation and arm configuration are those of the measured pose near the middle that is farthest from singular.
    Without a box, the table covers the largest cube of SIZES about a measured pose in which all points can be
    corrected. Corrections are interpolated linearly between nodes. Raises InputError if no node, or no point between
    nodes, can be reached.
    """
    saved = at_end(usable(saved))
    data = place.poses(measured_table(saved))
    tip = tips(saved, data, nominal=True)[1].tip
    points = tip[:, :3, 3]
    near = _far_from_singular(saved, data, points, points.mean(axis=0) if box is None else box.mean(axis=0))
    held = [_Held(saved, data.subset([at]), tip[at]) for at in near.tolist()]
    pose, within = _largest(held, float(np.ptp(points, axis=0).max())) if box is None else (held[0], box)
    grid = _over(pose, within, count, rng)
    if not len(grid.error):
        raise InputError(
            (
                "no point of the box is reachable with tool and arm oriented as at the measured poses; "
                "expected another box"
            ),
            "box",
        )
    return grid


def _over(held: "_Held", box: Array, count: int, rng: np.random.Generator, *, part: bool = True) -> Grid:
    sides = [np.linspace(low, high, count) for low, high in box.T]
    nodes = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    fresh = rng.uniform(box[0], box[1], (CHECKS if part else TRIALS, 3))
    q, start = np.split(held.nominal(np.vstack([nodes, fresh])), [len(nodes)])
    moves = held.corrections(nodes, q, part)
    text = table_text(_frame(held.saved, nodes, q, moves))
    moved = start + _interpolated(text, fresh)
    use = np.isfinite(moved).all(axis=1)
    before, after = np.split(held.misses(np.vstack([start[use], moved[use]]), np.vstack(2 * [fresh[use]])), 2)
    return Grid(text, after, before, float(np.isfinite(moves).all(axis=1).mean()), _state(held))


def _state(held: "_Held") -> str:
    """Return the payload and further inputs at which the joint corrections hold; empty without any."""
    near, units = held.near, held.saved.input_units
    loads = [f"payload {near.payload[0]:g} kg"] if near.payload_given else []
    return ", ".join([*loads, *(f"{name} {near.extras[name][0]:g} {units[name]}" for name in units)])


def _interpolated(text: str, points: Array) -> Array:
    """Interpolate the corrections, rad and m, of a lookup table linearly at points between its nodes, m."""
    table = pd.read_csv(io.StringIO(text))
    sides = [np.unique(table[f"{axis} [mm]"]) / 1e3 for axis in "xyz"]
    headers = [header for header in table if str(header).startswith("delta_")]
    units = [np.radians(1.0) if str(header).endswith("[deg]") else 1e-3 for header in headers]
    moves = table.sort_values([f"{axis} [mm]" for axis in "xyz"])[headers].to_numpy(dtype=float) * units
    nodes = moves.reshape(*map(len, sides), -1)
    return np.asarray(RegularGridInterpolator(sides, nodes, bounds_error=False, fill_value=None)(points))


def _largest(poses: Sequence["_Held"], spread: float) -> tuple["_Held", Array]:
    """Return the pose and the size of the largest correctable trial cube; the first pose and smallest cube if none
    is."""
    best, served = (poses[0], _cube(poses[0], SIZES[0] * spread)), 0
    for pose in poses[:TRIED]:
        while served < len(SIZES) and _serves(pose, cube := _cube(pose, SIZES[served] * spread)):
            best, served = (pose, cube), served + 1
    return best


def _serves(pose: "_Held", cube: Array) -> bool:
    """Return whether a cube is reachable in one arm configuration, with errors reduced to the accepted share LEFT."""
    tried = _over(pose, cube, PROBES, np.random.default_rng(0), part=False)
    whole = tried.reached == 1.0 and len(tried.error) == TRIALS
    return whole and bool(tried.error.max() < LEFT * root_mean_square(tried.before))


def _cube(pose: "_Held", half: float) -> Array:
    return np.asarray(pose.frame[:3, 3] + half * np.array([[-1.0], [1.0]]))


def _far_from_singular(saved: SavedModel, data: Dataset, points: Array, middle: Array) -> IntArray:
    """Return the poses near a middle point, m, sorted by decreasing smallest singular value of their Jacobians."""
    near = np.argsort(np.linalg.norm(points - middle, axis=1))[:NEAR]
    frames = tips(saved, data.subset(near), nominal=True)[1].tip
    jacobian = error_and_jacobian(saved, data.subset(near), frames, nominal=True)[1]
    return near[np.argsort(-np.linalg.svd(jacobian, compute_uv=False)[:, -1])]


@dataclass(frozen=True)
class _Held:
    """Orientation `frame` and arm configuration of a measured pose `near`, kept at all points of the lookup table."""

    saved: SavedModel
    near: Dataset
    frame: Array

    def targets(self, points: Array, q: Array | None = None) -> TargetPoses:
        """Return target poses of the tool at points, m. q: initial joint values; None for the joint values of the
        measured pose."""
        many = self.near.subset(np.zeros(len(points), dtype=np.int64))
        frames = np.repeat(self.frame[None], len(points), axis=0)
        frames[:, :3, 3] = points
        dataset = many if q is None else replace(many, q=q.copy())
        return TargetPoses(dataset, frames, len(self.saved.mechanism.joints) >= 6)

    def nominal(self, points: Array) -> Array:
        """Return nominal joint values at points, m, NaN if unreachable.

        Points are approached on straight lines from the measured pose, so that the arm configuration is kept. One
        Newton step follows the line to each of its intermediate points.
        """
        q = np.array(self.targets(points).dataset.q)
        for part in range(1, STEPS + 1):
            targets = self.targets(self.frame[:3, 3] + part / STEPS * (points - self.frame[:3, 3]), q)
            most = ITERATIONS if part == STEPS else 1
            q, left = solve(self.saved, targets.dataset, targets.frames, targets.whole, nominal=True, most=most)
        q[left > REACHED] = np.nan
        return q

    def corrections(self, points: Array, q: Array, part: bool) -> Array:
        """Return the corrections, rad and m, of nominal joint values q at points, NaN without a correction.

        part: True to reach the orientation only partly near singular poses.
        """
        moves = np.full_like(q, np.nan)
        here = np.flatnonzero(np.isfinite(q).all(axis=1))
        if len(here):
            real, status = corrected(self.saved, self.targets(points[here], q[here]), MAX_MOVE, part=part)
            moves[here] = np.where(np.isin(status, GIVEN)[:, None], real - q[here], np.nan)
        return moves

    def misses(self, q: Array, points: Array) -> Array:
        """Return the distance of the real tool from points, m, at joint values q."""
        if not len(q):
            return np.zeros(0)
        tip = tips(self.saved, self.targets(points, q).dataset, nominal=False)[1].tip
        return np.asarray(np.linalg.norm(tip[:, :3, 3] - points, axis=1))


def _frame(saved: SavedModel, points: Array, q: Array, moves: Array) -> pd.DataFrame:
    columns = {f"{a} [mm]": 1e3 * points[:, i] for i, a in enumerate("xyz")}
    kinds = [joint.kind for joint in saved.mechanism.joints]
    for before, values in (("", q), ("delta_", moves)):
        named = zip(saved.columns, kinds, values.T, strict=True)
        columns |= dict(joint_column(f"{before}{name}", kind, of) for name, kind, of in named)
    if (known := saved.convention) is not None and not known.unchanged:
        columns |= known.columns(q, PREFIX) | known.columns(q + moves, SENT)
    return pd.DataFrame(columns)
