"""Command `gpmodel import`: convert a file of another program to a table, a camera or a mechanism."""

import sys
from pathlib import Path

import click
import pandas as pd

from gpmodel.api.arguments import to_si
from gpmodel.characters import shell_quoted
from gpmodel.checks.guess import guess_files
from gpmodel.cli.console import path_for, write_frame
from gpmodel.cli.options import PATH, mechanism_options, quiet_option
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.files import write_text
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.described import read_boards, read_cameras
from gpmodel.model.pixel import WORLD
from gpmodel.table.cells import table_text
from gpmodel.table.foreign import ColumnMap, Imported, import_file, read_map, unread
from gpmodel.table.join import read_files
from gpmodel.table.of_programs import calibrated_rows, calibrated_urdf, camera_or_corners, figaroh_map, is_figaroh
from gpmodel.table.read import dataset_from
from gpmodel.table.ros_bag import bag_table, is_bag
from gpmodel.texts import toml_text

SHOWN = 5
"""Number of rows of an imported table that are printed."""


@click.command("import")
@click.argument("files", metavar="FILE...", type=PATH, nargs=-1, required=True)
@click.option("--guess", "guessing", is_flag=True, help="Infer the meaning of the columns; needs --mechanism.")
@click.option("--yes", is_flag=True, help="With --guess: accept the inferred meaning despite doubts.")
@click.option("--map", "map_file", type=PATH, help="TOML map of the columns: [columns], [tool.NAME], [orientation].")
@click.option("--join", metavar="HOW", help="How to join two files: order, 'No = Point' or 'time t = Time'.")
@mechanism_options(required=False)
@click.option("--joints", type=PATH, help="Table of joint values, one row per image of a board.")
@click.option("--square", metavar="SIZE", help="Distance of neighbouring corners of the board, as in 24mm.")
@click.option("--topic", help="Topic of the measurements in a ROS bag with several topics.")
@click.option("--nominal", type=PATH, help="Nominal description of a calibration: urcontrol.conf, a URDF.")
@click.option("--out", type=PATH, help="Output table, .csv. [default: print the table]")
@quiet_option
def import_table(
    files: tuple[Path, ...], guessing: bool, yes: bool, map_file: Path | None, join: str | None,
    mechanism: Mechanism | None, joints: Path | None, square: str | None, topic: str | None, nominal: Path | None,
    out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Convert a FILE of another program to a file for gpmodel.

    --guess infers the meaning of the columns from the column names and from the fit of --mechanism M. The command
    prints the inferred meaning and its doubts, and writes a table and a map, with which --map repeats the import. Joint
    values and positions may be in two files.

    A FIGAROH table, a ROS bag (--mechanism M defines the prismatic joints) and corners of OpenCV (--joints, --square)
    are converted to a table. A camera's YAML of ROS or OpenCV is converted to a --cameras file. UR's calibration.conf
    and robot_calibration's offsets (--nominal) are converted to a mechanism.
    A table of another layout needs a map. For every column of the table, the map names a column of the file, or a
    formula of columns, and the unit:

    \b
        [columns]
        J1 = "shoulder_pan_joint [rad]"
        x = "target_x - error_x [mm]"
        [orientation]
        columns = ["roll [deg]", "pitch [deg]", "yaw [deg]"]
        convention = "intrinsic XYZ"
    """
    file = files[0]
    if out is not None and out.exists() and any(out.samefile(f) for f in files if f.exists()):
        raise InputError(f"--out {out}: is the imported file; expected another name")
    given = {"map_file": map_file, "mechanism": mechanism, "joints": joints, "square": square, "topic": topic,
             "nominal": nominal, "guessing": guessing or None, "yes": yes or None, "join": join}  # fmt: skip
    if len(files) > 1 and map_file is None and not guessing:
        raise InputError(f"{files[1]}: a second file; expected --guess or --map too")
    read: tuple[str, ...]
    if guessing:
        made, read = _guessed(files, mechanism, (join, yes, quiet), out), ("guessing", "mechanism", "yes", "join")
    elif map_file is not None:
        made, read = _mapped(files, read_map(map_file), join or ""), ("map_file", "join")
    elif is_bag(file):
        made, read = bag_table(file, mechanism, topic), ("mechanism", "topic")
    elif file.suffix.lower() == ".conf":
        made, read = calibrated_rows(file, nominal), ("nominal",)
    elif file.suffix.lower() in (".yaml", ".yml") and nominal is not None:
        made, read = calibrated_urdf(file, nominal), ("nominal",)
    elif file.suffix.lower() in (".yaml", ".yml"):
        size = None if square is None else to_si(square, "length", "square", positive=True)
        made, read = camera_or_corners(file, joints, size), ("joints", "square")
    elif is_figaroh(file):
        made, read = _mapped(files, figaroh_map(file, mechanism), ""), ("mechanism",)
    elif not file.exists():
        raise InputError(f"{file}: cannot be read (No such file or directory); expected a file to import")
    else:
        raise InputError(f"{file}: unknown layout; expected --map MAP.toml, or --guess with --mechanism M")
    if surplus := [name for name, value in given.items() if value is not None and name not in read]:
        raise InputError(f"does not apply to {file.name}; omit the option", surplus[0])
    _check(made, file)
    for text in () if quiet else made.left_out:
        echo(f"left out, {text}", err=True)
    _write(made, file, out, quiet)


def _mapped(files: tuple[Path, ...], columns: ColumnMap, join: str) -> Imported:
    """Import files by a map of columns (table column -> file column)."""
    sheet = read_files(files, join or columns.join, columns.header)
    return Imported(import_file(sheet, columns), left_out=unread(sheet, columns))


def _guessed(
    files: tuple[Path, ...], mechanism: Mechanism | None, said: tuple[str | None, bool, bool], out: Path | None
) -> Imported:
    """Infer the columns of files, print the result, let the user confirm doubts, and return table and map.

    said: values of --join, --yes and --quiet. Raises InputError if no interpretation fits, or if a doubt cannot be
    confirmed because the input is no terminal.
    """
    (join, yes, quiet), file = said, files[0]
    if mechanism is None:
        raise InputError("needs the joints of a mechanism; expected --mechanism M too", "guessing")
    sheet, found = guess_files(files, mechanism, join)
    table = import_file(sheet, found.map)
    dataset_from(table, Path(sheet.source), mechanism)
    echo("\n".join([*sheet.said, *found.lines, table.head(SHOWN).to_string(index=False)]), err=out is None or quiet)
    for doubt in found.doubts:
        echo(f"doubt: {doubt}", err=True)
    if found.doubts and not yes:
        if not sys.stdin.isatty():
            raise InputError(f"{file.name}: {'; '.join(found.doubts)}; expected --yes to accept the proposal above")
        click.confirm("Accept the proposal above?", abort=True, err=True)
    return Imported(table, {"map": found.map.content()})


def _check(made: Imported, file: Path) -> None:
    """Raise InputError if the imported descriptions of cameras and boards could not be read back."""
    parts = {"cameras": made.content, **made.described} if isinstance(made.content, dict) else made.described
    try:
        for name, content in parts.items():
            if name != "map":
                {"cameras": read_cameras, "board": read_boards}[name](content, lambda *_: WORLD)
    except InputError as error:
        raise InputError(f"{file.name}: {error}") from None


def _write(made: Imported, file: Path, out: Path | None, quiet: bool) -> None:
    path: Path | None = out
    if not isinstance(made.content, pd.DataFrame):
        text = made.content if isinstance(made.content, str) else toml_text(made.content)
        if out is None:
            echo(text, nl=False)
            return
        write_text(out, text)
        said = "written"
    else:
        path = None if out is None else path_for(out, f"{file.stem}.table.csv")
        ours = path is not None and path.with_suffix(".map.toml").exists()
        if path is not None and path.is_file() and not ours and path.read_bytes() != table_text(made.content).encode():
            raise InputError(f"{path}: exists with other content; expected another name", "out")
        path = write_frame(made.content, out, f"{file.stem}.table.csv")
        said = f"{len(made.content)} rows, {len(made.content.columns)} columns"
    beside = {} if path is None else {name: path.with_suffix(f".{name}.toml") for name in made.described}
    for name, where in beside.items():
        write_text(where, toml_text(made.described[name]))
    if not quiet and path is not None:
        options = "".join(f" --{name} {shell_quoted(where)}" for name, where in beside.items() if name != "map")
        options = options and f"; read with{options}"
        options += f"; {beside['map']} repeats it" if "map" in beside else ""
        echo(f"{said} in {path}{options}")
