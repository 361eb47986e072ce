"""Predict the measurements of the instrument at unmeasured poses."""

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd

from gpmodel.application.kinematics import matched_with_readings
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import check_finite, out_of_range
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.unmeasured_joints import free_joints, solve_joints
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.model.observed import Observed
from gpmodel.numerics.se3 import rotation_vector
from gpmodel.progress import Progress, Say, silent
from gpmodel.table.cells import with_results
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import joint_column, split_header


def point_deviation(saved: SavedModel, poses: Poses, observed: Observed) -> Array:
    """Return the standard deviation of predicted points, m, without instrument noise; NaN for unfitted models.

    The standard deviation is √(trace(J Σ Jᵀ) + 3 d²), with derivatives J of the point, covariance Σ of the parameters
    over alternative explanations of the findings, and model discrepancy d.
    """
    return np.asarray(np.linalg.norm(coordinate_deviations(saved, poses, observed), axis=1))


def coordinate_deviations(saved: SavedModel, poses: Poses, observed: Observed) -> Array:
    """Return the standard deviation of each predicted coordinate in the axes of the instrument, m."""
    if len(saved.stderr) and not saved.covariance.placement:
        return np.full((len(poses), 3), np.nan)
    columns = point_columns(saved, poses, observed, saved.covariance.alternatives)
    variance: Array = np.sum((columns @ saved.covariance.predictive) * columns, axis=2)
    return np.sqrt(np.maximum(variance, 0.0) + saved.discrepancy**2)


def point_columns(saved: SavedModel, poses: Poses, observed: Observed, more: Sequence[Effect] = ()) -> Array:
    """Return the derivatives of each predicted point with respect to registration, tool, all effects of the model and
    the effects `more`."""
    effects = effect_columns((*saved.model.effects, *more), saved.model, poses, observed)[:, :3]
    return np.concatenate([placement_columns(saved, poses, observed), effects], axis=2)


def placement_columns(saved: SavedModel, poses: Poses, observed: Observed) -> Array:
    """Return the derivatives of each predicted point with respect to registration and tool, in the instrument's
    axes."""
    tip, labels = observed.tip, poses.dataset
    out = np.zeros((len(tip), 3, len(saved.covariance.placement)))
    arm = tip[:, :3, 3] - saved.covariance.centre
    for k, name in enumerate(saved.covariance.placement):
        what, axis = name.split(" ", 1)[0], name.rsplit(" ", 1)[1]
        if what not in ("registration", "tool"):
            continue
        label = name.removeprefix(what).removesuffix(axis).strip()
        here = labels.label("setup" if what == "registration" else "tool") == label
        unit = np.eye(3)[AXES.index(axis) % 3]
        if what == "registration":
            out[here, :, k] = unit if axis.startswith("T") else np.cross(unit, arm[here])
        elif axis.startswith("T"):
            out[here, :, k] = tip[here, :3, :3] @ unit
    return out


_MEASURED = re.compile(r"r?[xyz]|distance_.*")
"""Names of table columns with measurements or targets."""
AT_ONCE = 5000
"""Number of poses predicted at a time; the derivatives take a tenth of a gigabyte."""


def predicted_columns(saved: SavedModel, dataset: Dataset, say: Say = silent) -> dict[str, Array]:
    """Return predicted columns for a table of poses, by header.

    The columns are x y z [mm] and, if rotations were fitted, rx ry rz [deg], in the instrument's frame; distances [mm]
    from known fixed points; solved approximate joint values with the residual [um], if points were measured; sigma
    [mm], the standard deviation of the point; `outside`, the inputs beyond the ranges of the fit.
    say: function called with progress messages. Raises InputError as `matched_with_readings`, or if an effect is
    infinite or undefined.
    """
    poses, parts = prepare(saved.mechanism, matched_with_readings(saved, dataset)), list[dict[str, Array]]()
    solved = bool(free_joints(saved.mechanism)) and bool(np.isfinite(poses.dataset.position).any())
    for rows in batches(len(poses)):
        if len(rows) < len(poses):
            say(Progress(f"{rows[0]} of {len(poses)} poses predicted", passing=True))
        parts.append(_predicted(saved, poses.subset(rows), solved))
    return {header: np.concatenate([part[header] for part in parts]) for header in parts[0]}


def batches(count: int) -> list[IntArray]:
    """Divide the row numbers of a table, in order, into batches of at most 5000 (AT_ONCE)."""
    return np.array_split(np.arange(count), -(-count // AT_ONCE))


def observed_by(saved: SavedModel, given: Poses) -> tuple[Poses, Observed]:
    """Solve approximate joint values of the poses; return the solved poses and all predicted measurements."""
    poses = solve_joints(saved.model, given, saved.theta, saved.placement, saved.weights)
    return poses, observe(saved.model, poses, saved.theta, saved.placement)


def _predicted(saved: SavedModel, given: Poses, solved: bool) -> dict[str, Array]:
    """Predict a batch of poses. solved: True to return also joint values that were solved from measurements."""
    check_finite(saved, given)
    poses, observed = observed_by(saved, given)
    tip = observed.tip
    columns = {f"{a} [mm]": 1e3 * tip[:, i, 3] for i, a in enumerate("xyz")}
    if saved.pose:
        turns = np.degrees(rotation_vector(tip[:, :3, :3]))
        columns |= {f"r{a} [deg]": turns[:, i] for i, a in enumerate("xyz")}
    register = saved.placement.roots(given.dataset)
    for name, anchor in saved.placement.anchors.items():
        if not name.startswith("distance_"):
            continue
        there = register[:, :3, :3] @ anchor[:3] + register[:, :3, 3]
        columns[f"{name} [mm]"] = 1e3 * (np.linalg.norm(tip[:, :3, 3] - there, axis=1) + anchor[3])
    if solved:
        for i in free_joints(saved.mechanism):
            joint = saved.mechanism.joints[i]
            header, values = joint_column(f"solved_{joint.name}", joint.kind, poses.dataset.q[:, i])
            columns[header] = values
        columns["residual [um]"] = 1e6 * np.linalg.norm(given.dataset.position - tip[:, :3, 3], axis=1)
    columns["sigma [mm]"] = 1e3 * point_deviation(saved, poses, observed)
    columns["outside"] = np.array(out_of_range(saved, poses.states.seen_at(tip[:, :3, 3])), dtype=object)
    return columns


def beside(frame: pd.DataFrame, columns: dict[str, Array]) -> pd.DataFrame:
    """Add predicted columns to a table.

    A prediction of a column that the table has, such as x or distance_A, is named `predicted_x`; columns of an earlier
    prediction are replaced.
    """
    taken = {name for header in frame.columns if _MEASURED.fullmatch(name := split_header(str(header))[0])}
    results = {f"predicted_{h}" if split_header(h)[0] in taken else h: values for h, values in columns.items()}
    return with_results(frame, results, ("predicted_", "solved_"))


def misses(dataset: Dataset, columns: dict[str, Array]) -> Array:
    """Return the distance between measured and predicted point, mm, of the rows with x, y and z."""
    tip = np.column_stack([columns[f"{a} [mm]"] for a in "xyz"])
    error: Array = np.linalg.norm(1e3 * dataset.position - tip, axis=1)
    return error[np.isfinite(error)]
