"""`gpmodel import`: a measured file of another program as a table this program reads."""

from pathlib import Path

import click

from gpmodel.cli.console import write_frame
from gpmodel.cli.options import quiet_option
from gpmodel.errors import InputError
from gpmodel.table.foreign import import_file, read_map


@click.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--map", "map_file", required=True, type=click.Path(path_type=Path), help="TOML: [columns], [orientation]."
)
@click.option("--out", type=click.Path(path_type=Path), default=None, help="The table, .csv. [default: print it]")
@quiet_option
def import_table(file: Path, map_file: Path, out: Path | None, quiet: bool) -> None:
    """Turn a measured FILE of any layout into a table of poses, by a map of its columns.

    The map names for every column of the table the file's column, or a formula of its columns, and the unit:

    \b
        [columns]
        J1 = "shoulder_pan_joint [rad]"
        x = "target_x - error_x [mm]"
        [orientation]
        columns = ["roll [deg]", "pitch [deg]", "yaw [deg]"]
        convention = "intrinsic XYZ"
    """
    if out is not None and out.exists() and out.samefile(file):
        raise InputError(f"--out {out}: is the file itself; expected another name")
    frame = import_file(file, read_map(map_file))
    path = write_frame(frame, out, f"{file.stem}.table.csv")
    if not quiet and path is not None:
        click.echo(f"{len(frame)} rows, {len(frame.columns)} columns in {path}")
