"""`gpmodel import`: a file of another program as a table, a camera or a mechanism this program reads."""

from pathlib import Path

import click
import pandas as pd

from gpmodel.api.arguments import quantity
from gpmodel.cli.console import write_frame
from gpmodel.cli.options import PATH, mechanism_options, quiet_option
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.files import write_text
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.described import boards_of, cameras_of
from gpmodel.model.pixel import WORLD
from gpmodel.table.figaroh import figaroh_table, is_figaroh
from gpmodel.table.foreign import import_file, read_map, unread
from gpmodel.table.imported import Imported
from gpmodel.table.opencv import camera_or_corners
from gpmodel.table.robot_calibration import calibrated_urdf
from gpmodel.table.ros_bag import bag_table, is_bag
from gpmodel.table.ur_conf import calibrated_rows
from gpmodel.texts import toml_text


@click.command("import")
@click.argument("file", type=PATH)
@click.option("--map", "map_file", type=PATH, help="TOML: [columns], [orientation].")
@mechanism_options(required=False)
@click.option("--joints", type=PATH, help="Of corners: joint values, a row a view.")
@click.option("--square", metavar="SIZE", help="Of corners: from one to the next, as in 24mm.")
@click.option("--topic", help="Of a ROS bag: the measurements, where several topics hold some.")
@click.option("--nominal", type=PATH, help="What a calibration corrects: urcontrol.conf, a URDF.")
@click.option("--out", type=PATH, help="The table, .csv. [default: print it]")
@quiet_option
def import_table(
    file: Path, map_file: Path | None, mechanism: Mechanism | None, joints: Path | None, square: str | None,
    topic: str | None, nominal: Path | None, out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Turn a FILE of another program into what this one reads.

    A table of FIGAROH and a ROS bag (--mechanism M says which joints slide), corners of OpenCV (--joints, --square)
    become a table; a camera's YAML of ROS or OpenCV a --cameras file; UR's calibration.conf and robot_calibration's
    offsets (--nominal) a mechanism.
    A table of any other layout goes by a map, which names for every column the file's column, or a formula of its
    columns, and the unit:

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
    given = {"map_file": map_file, "mechanism": mechanism, "joints": joints, "square": square, "topic": topic,
             "nominal": nominal}  # fmt: skip
    read: tuple[str, ...]
    if map_file is not None:
        columns = read_map(map_file)
        made, read = Imported(import_file(file, columns), left_out=unread(file, columns)), ("map_file",)
    elif is_bag(file):
        made, read = bag_table(file, mechanism, topic), ("mechanism", "topic")
    elif file.suffix.lower() == ".conf":
        made, read = calibrated_rows(file, nominal), ("nominal",)
    elif file.suffix.lower() in (".yaml", ".yml") and nominal is not None:
        made, read = calibrated_urdf(file, nominal), ("nominal",)
    elif file.suffix.lower() in (".yaml", ".yml"):
        size = None if square is None else quantity(square, "length", "square", positive=True)
        made, read = camera_or_corners(file, joints, size), ("joints", "square")
    elif is_figaroh(file):
        made, read = figaroh_table(file, mechanism), ("mechanism",)
    else:
        raise InputError(f"{file}: of no layout that is known here; expected --map MAP.toml beside it")
    if surplus := [name for name, value in given.items() if value is not None and name not in read]:
        raise InputError(f"says nothing of {file.name}; leave it away", surplus[0])
    _check(made, file)
    for text in () if quiet else made.left_out:
        echo(f"left out, {text}", err=True)
    _write(made, file, out, quiet)


def _check(made: Imported, file: Path) -> None:
    """Raises InputError where the cameras and boards that would be written could not be read again."""
    parts = {"cameras": made.content, **made.described} if isinstance(made.content, dict) else made.described
    try:
        for name, content in parts.items():
            {"cameras": cameras_of, "board": boards_of}[name](content, lambda *_: WORLD)
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
        path = write_frame(made.content, out, f"{file.stem}.table.csv")
        said = f"{len(made.content)} rows, {len(made.content.columns)} columns"
    beside = {} if path is None else {name: path.with_suffix(f".{name}.toml") for name in made.described}
    for name, where in beside.items():
        write_text(where, toml_text(made.described[name]))
    if not quiet and path is not None:
        options = "".join(f" --{name} {where}" for name, where in beside.items())
        echo(f"{said} in {path}{options and f'; read with{options}'}")
