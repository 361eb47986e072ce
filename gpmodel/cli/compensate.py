"""`gpmodel compensate`: corrected joint values."""

from pathlib import Path

import click
import numpy as np
import pandas as pd

from gpmodel.application.compensate import Compensation, compensate_joints, compensate_targets
from gpmodel.application.model_file import load_model
from gpmodel.cli.console import write_frame
from gpmodel.cli.options import out_file_option, quiet_option, seed_option
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.read import dataset_from, read_frame
from gpmodel.table.units import split_header
from gpmodel.table.write import joint_column


def with_correction(frame: pd.DataFrame, mechanism: Mechanism, found: Compensation) -> pd.DataFrame:
    """`frame` with corrected_JOINT, the correction and what is left [mm] and the status of each row."""
    out = frame.copy()
    for joint, values in zip(mechanism.joints, found.q.T, strict=True):
        header, scaled = joint_column(f"corrected_{joint.name}", joint.kind, values)
        out[header] = ["" if np.isnan(v) else f"{v:.9f}" for v in scaled]
    out["correction [mm]"] = [f"{1e3 * v:.6f}" for v in found.correction]
    out["residual [mm]"] = [f"{1e3 * v:.6f}" for v in found.residual]
    out["status"] = list(found.status)
    return out


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@seed_option
@out_file_option
@quiet_option
def compensate(model: Path, targets: Path, seed: int, out: Path | None, quiet: bool) -> None:
    """Joint values that make the real mechanism reach nominal TARGETS, a status per row.

    TARGETS: joint values, whose nominal tool pose is to be reached; or, without joint columns, the tool's x, y, z
    in the mechanism's root frame, with rx, ry, rz for its whole pose. MODEL: model.json of calibrate or discover.
    Rows whose status is not ok have no corrected values.
    """
    saved = load_model(model)
    mechanism = saved.mechanism
    frame, _ = read_frame(targets)
    names = {split_header(str(c))[0] for c in frame.columns}
    numbered = {f"J{i}" for i in range(1, len(mechanism.joints) + 1)}
    if names & (numbered | {j.name for j in mechanism.joints}):
        found = compensate_joints(saved, dataset_from(frame, targets, mechanism, need_measurement=False))
    elif names & {"x", "y", "z"}:
        units = {"revolute": "rad", "prismatic": "m"}
        zeros = {f"{j.name} [{units[j.kind]}]": ["0"] * len(frame) for j in mechanism.joints}
        dataset = dataset_from(frame.assign(**zeros), targets, mechanism)
        found = compensate_targets(saved, dataset, np.random.default_rng(seed))
    else:
        raise InputError(f"{targets.name}: no targets; expected joint columns, or x, y and z in the root frame")
    path = write_frame(with_correction(frame, mechanism, found), out, "compensated.csv")
    if not quiet and path is not None:
        failed = sum(s != "ok" for s in found.status)
        click.echo(f"{len(frame) - failed} of {len(frame)} targets reached in {path}")
