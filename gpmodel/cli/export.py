"""`gpmodel export`: the model in the forms that others read."""

from pathlib import Path

import click

from gpmodel.api.model import load_model, model_file
from gpmodel.application.exports.grid import NODES
from gpmodel.cli.options import quiet_option, seed_option


@click.command()
@click.argument("result", metavar="RESULT", type=click.Path(path_type=Path))
@click.option("--box", default=None, metavar="X:X,Y:Y,Z:Z",
              help="Of the lookup grid in the root frame, as in 800:1200,-200:200,300:700mm.")  # fmt: skip
@click.option("--nodes", default=NODES, show_default=True, type=click.IntRange(2), help="Of it along each side.")
@click.option("--setup", default=None, metavar="NAME",
              help="Whose registration model.py and model.c have, of several. [default: the first]")  # fmt: skip
@click.option("--tool", default=None, metavar="NAME",
              help="Whose point they and the grid have, of several. [default: the first]")  # fmt: skip
@seed_option
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None, help="Folder. [default: RESULT]")
@quiet_option
def export(
    result: Path, box: str | None, nodes: int, setup: str | None, tool: str | None, seed: int, folder: Path | None,
    quiet: bool,
) -> None:  # fmt: skip
    """Write the model of RESULT, a folder of calibrate or discover or its model.json, in the forms that others read.

    calibrated.urdf and exports/dh_*.toml, kinematics.yaml (xacro), joint_offsets.yaml (robot_calibration),
    ur_kinematics.yaml (ur_description) and robodk.csv hold a geometry refitted without what they cannot; model.py and
    model.c the whole model; model.tex its terms; grid.csv joint corrections at the nodes of a box. Each error is
    against `gpmodel predict` on fresh poses. SDF and MJCF: Gazebo and MuJoCo read calibrated.urdf themselves.
    """
    file = model_file(result)
    exports = load_model(file).export(box=box, nodes=nodes, setup=setup, tool=tool, seed=seed)
    exports.report(folder or file.parent)
    if not quiet:
        click.echo(exports.summary())
