"""`gpmodel predict`: what the instrument would read."""

from pathlib import Path

import click
import numpy as np
import pandas as pd

from gpmodel.application.model_file import SavedModel, load_model, matched
from gpmodel.calibration.unmeasured_joints import free_joints, solve_joints
from gpmodel.cli.console import write_frame
from gpmodel.cli.options import out_file_option, quiet_option, seed_option
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.se3 import rotation_vector
from gpmodel.table.dataset import Dataset
from gpmodel.table.read import dataset_from, read_frame
from gpmodel.table.units import split_header


def predicted_columns(saved: SavedModel, dataset: Dataset) -> dict[str, np.ndarray]:
    """Columns by header, each (N,): x y z [mm] and, where the model was fitted to poses, rx ry rz [deg], both in
    the instrument's frame; and the distances [mm] the model knows anchors for. Approximate joint values are solved
    against what the row measured first, and added with the residual [um] they leave."""
    fitting = matched(saved, dataset)
    poses = solve_joints(saved.model, prepare(saved.mechanism, fitting), saved.theta, saved.placement)
    tip = observe(saved.model, poses, saved.theta, saved.placement).tip
    columns = {f"{a} [mm]": 1e3 * tip[:, i, 3] for i, a in enumerate("xyz")}
    if saved.pose:
        turns = np.degrees(rotation_vector(tip[:, :3, :3]))
        columns |= {f"r{a} [deg]": turns[:, i] for i, a in enumerate("xyz")}
    register = np.stack([saved.placement.registration[s] for s in fitting.label("setup").tolist()])
    for name, anchor in saved.placement.anchors.items():
        there = register[:, :3, :3] @ anchor + register[:, :3, 3]
        columns[f"{name} [mm]"] = 1e3 * np.linalg.norm(tip[:, :3, 3] - there, axis=1)
    if (free := free_joints(saved.mechanism)) and np.isfinite(fitting.position).any():
        for i in free:
            joint = saved.mechanism.joints[i]
            factor, unit = (np.degrees(1.0), "deg") if joint.kind == "revolute" else (1e3, "mm")
            columns[f"solved_{joint.name} [{unit}]"] = factor * poses.dataset.q[:, i]
        columns["residual [um]"] = 1e6 * np.linalg.norm(fitting.position - tip[:, :3, 3], axis=1)
    return columns


def with_prediction(frame: pd.DataFrame, columns: dict[str, np.ndarray]) -> pd.DataFrame:
    """`frame` and the columns; one that the frame measured already is added as `predicted_NAME`."""
    taken = {split_header(str(c))[0] for c in frame.columns}
    out = frame.copy()
    for header, values in columns.items():
        name = split_header(header)[0]
        out[f"predicted_{header}" if name in taken else header] = [f"{v:.6f}" for v in values]
    return out


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("poses", type=click.Path(path_type=Path))
@seed_option
@out_file_option
@quiet_option
def predict(model: Path, poses: Path, seed: int, out: Path | None, quiet: bool) -> None:
    """Add predicted x, y, z [mm] in the instrument's frame to a table of joint values.

    MODEL is a model.json of calibrate or discover. POSES keeps its columns; where it has x, y, z already, the
    prediction is added as predicted_x, predicted_y, predicted_z.
    """
    saved = load_model(model)
    frame, _ = read_frame(poses)
    dataset = dataset_from(frame, poses, saved.mechanism, need_measurement=False)
    columns = predicted_columns(saved, dataset)
    path = write_frame(with_prediction(frame, columns), out, "predicted.csv")
    if quiet:
        return
    if any("row" in effect.inputs for effect in saved.model.effects):
        click.echo(f"{poses}: the model reads row; row k is taken for row k of the session it was fitted to", err=True)
    if path is None:
        return
    tip = np.column_stack([columns[f"{a} [mm]"] for a in "xyz"])
    error = np.linalg.norm(1e3 * dataset.position - tip, axis=1)
    error = error[np.isfinite(error)]
    said = f"; against the table's own: mean {error.mean():.4f}, max {error.max():.4f} mm" if len(error) else ""
    click.echo(f"{len(dataset)} poses predicted in {path}{said}")
