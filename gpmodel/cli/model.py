"""Commands that use a fitted model (model.json): predict, compensate, export, verify."""

from contextlib import suppress
from math import isfinite
from pathlib import Path

import click

from gpmodel.api.certificate import certificate as certify
from gpmodel.api.model import Point, load_model, model_file
from gpmodel.api.verify import NextCheck, verify_next
from gpmodel.api.verify import verify as judge
from gpmodel.application.compensate import not_reached
from gpmodel.application.exports.grid import NODES
from gpmodel.application.exports.programs import Language, convention_notes
from gpmodel.characters import shell_quoted
from gpmodel.cli import options as shared
from gpmodel.cli.console import (
    command_line,
    convention_note,
    deliver,
    place_for,
    progress_line,
    session_note,
    write_frame,
)
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.files import write_bytes, write_text
from gpmodel.table.robot_programs import is_program, read_program
from gpmodel.wording import turned


@click.command()
@shared.model_argument
@click.argument("poses", type=shared.PATH)
@click.option("--as-measured", is_flag=True, help="Include the fitted errors of the instrument in the prediction.")
@shared.session_option
@shared.in_order_option
@shared.out_file_option
@shared.quiet_option
def predict(
    model: Path, poses: Path, as_measured: bool, session: bool, in_order: bool, out: Path | None, quiet: bool
) -> None:
    """Add predicted x, y, z [mm] in the instrument's frame to a table of joint values: the tool at the end of the
    fitted session, without the errors of the instrument.

    MODEL is a model.json of calibrate or discover. Joint columns have the signs and zeros of the description; columns
    controller_A1, ... and robot programs have those of the imported axes.
    The output keeps the columns of POSES. If POSES has x, y, z, the
    prediction is added as predicted_x, predicted_y, predicted_z. Columns of an earlier prediction are replaced. sigma
    is the standard deviation of the predicted point; `outside` names the inputs beyond the ranges of the fit.
    """
    fitted = load_model(model)
    place_for(out, "predicted.csv", poses)
    with progress_line(quiet) as say:
        predicted, error = fitted.judged(poses, as_measured, session, in_order, say)
        path = write_frame(predicted, out, "predicted.csv", poses)
    if quiet:
        return
    if names := fitted.of_its_session(session=session):
        echo(session_note(names, session), err=True)
    if said := convention_note(fitted, poses):
        echo(said, err=True)
    if path is not None:
        against = f"; against the table's own: mean {error.mean():.4f}, max {error.max():.4f} mm" if len(error) else ""
        beyond = int((predicted.filter(regex="outside$") != "").any(axis=1).sum())
        warned = f"; {beyond} of them outside the measured range" if beyond else ""
        echo(f"{len(predicted)} poses predicted in {path}{warned}{against}")


WHICH = {"tool": "point", "frame": "origin"}
"""Name of the corrected point for each value of --point, tool or frame."""
PROGRAMS: dict[str, Language] = {".mod": "RAPID", ".dat": "KRL"}
"""Language of a robot program by file suffix."""


@click.command()
@shared.model_argument
@click.argument("targets", type=shared.PATH)
@click.option("--max-move", type=shared.Number(above=0.0), default=2.0, show_default=True, metavar="DEG",
              help="Largest correction of a joint value.")  # fmt: skip
@click.option("--point", type=click.Choice(["tool", "frame"]), default="tool", show_default=True,
              help="Point brought to x, y, z: tool point, or origin of the measured link (flange).")  # fmt: skip
@shared.session_option
@shared.in_order_option
@shared.seed_option
@click.option("--out", type=shared.PATH,
              help="A .csv file or a folder; .mod (RAPID) or .dat (KRL) of a program. [default: print]")  # fmt: skip
@shared.quiet_option
def compensate(
    model: Path,
    targets: Path,
    max_move: float,
    point: Point,
    session: bool,
    in_order: bool,
    seed: int,
    out: Path | None,
    quiet: bool,
) -> None:
    """Compute joint values that bring the real mechanism to nominal TARGETS, with a status per row.

    TARGETS: joint values, whose nominal tool pose is the target; or, without joint columns, x, y, z of --point in the
    mechanism's root frame, with rx, ry, rz for a full pose; or a robot program: KRL (.src, .dat), RAPID (.mod),
    URScript (.script), Fanuc (.ls). With --out of its suffix, the program is written with corrected joint targets; all
    other text is kept. MODEL: model.json of calibrate or discover.

    Convention: joint columns J1, ... and corrected_J1, ... have the signs and zeros of the description. Columns
    controller_A1, ... (targets) and to_controller_A1, ... (corrected), and robot programs, have those of the
    controller, as `gpmodel import` found them; a program states its convention. Columns of an earlier compensation in
    TARGETS are replaced.

    Statuses with corrected values: ok; near singular (the position is reached, not all of the orientation); outside the
    measured range; side of play open (a joint with backlash arrives from another side than without correction).
    Statuses without corrected values: large move, joint limit, not reached.
    """
    fitted = load_model(model)
    whole = is_program(targets) and (out is None or out.suffix.lower() == targets.suffix.lower())
    language = None if out is None else PROGRAMS.get(out.suffix.lower())
    if not language and not whole:
        place_for(out, "compensated.csv", targets)
    corrected = fitted.compensate(
        targets, max_move=max_move, point=point, session=session, in_order=in_order, seed=seed
    )  # fmt: skip
    path = out
    if whole:
        path = _write_program(fitted.rewrite(targets, corrected), targets, out)
    elif out is not None and language:
        write_text(out, fitted.program(corrected, language, out.stem))
    else:
        path = write_frame(corrected, out, "compensated.csv", targets)
    if not quiet and (names := fitted.of_its_session(session=session)):
        echo(session_note(names, session), err=True)
    if lost := not_reached(fitted.mechanism, corrected):
        echo(lost, err=True)
    if not quiet and (said := convention_note(fitted, targets)):
        echo(said, err=True)
    if not quiet and (whole or language):
        unchanged = read_program(targets).cartesian if whole else 0
        notes = [f"{unchanged} Cartesian positions of {targets.name} are NOT corrected"] * bool(unchanged)
        echo("\n".join([*notes, *convention_notes(fitted.saved.convention)]), err=True)
    if not quiet and path is not None:
        counts = ", ".join(f"{count} {status}" for status, count in corrected["status"].value_counts().items())
        largest = corrected["correction [mm]"].max()
        moved = f"corrections of the {point} {WHICH[point]} up to {largest:.4f} mm"
        if isfinite(turn := corrected["residual_turn [mrad]"].max()):
            moved += f", up to {turn:.4f} mrad of the orientation not reached{turned(turn, fitted.saved.lever)}"
        echo(f"{len(corrected)} targets in {path}: {counts}; {moved}")


def _write_program(text: str, source: Path, out: Path | None) -> Path | None:
    """Write a corrected robot program, or print it; return its path. Raises InputError if it would replace itself."""
    if out is None:
        echo(text, nl=False)
        return None
    if out.exists() and out.samefile(source):
        raise InputError(f"{out} is the program with the targets, expected another file", "out")
    write_bytes(out, text.encode(errors="surrogateescape"))
    return out


@click.command()
@click.argument("result", metavar="RESULT", type=shared.PATH)
@click.option("--box", metavar="X:X,Y:Y,Z:Z",
              help="Box of the lookup grid in the root frame, as in 800:1200,-200:200,300:700mm.")  # fmt: skip
@click.option("--nodes", default=NODES, show_default=True, type=click.IntRange(2), help="Grid nodes along each side.")
@click.option("--setup", metavar="NAME",
              help="Set-up whose registration model.py and model.c contain. [default: the first]")  # fmt: skip
@click.option(
    "--tool",
    metavar="NAME",
    help="Tool whose point model.py, model.c and grid.csv contain. [default: the first]",
)
@shared.seed_option
@click.option("--out", "folder", type=shared.PATH, help="Folder for the exported files. [default: RESULT]")
@shared.quiet_option
def export(
    result: Path, box: str | None, nodes: int, setup: str | None, tool: str | None, seed: int, folder: Path | None,
    quiet: bool,
) -> None:  # fmt: skip
    """Write the model of RESULT, a folder of calibrate or discover or its model.json, in formats of other programs.

    calibrated.urdf and exports/dh_*.toml, kinematics.yaml (xacro), joint_offsets.yaml (robot_calibration),
    ur_kinematics.yaml (ur_description) and robodk.csv contain a geometry refitted without the effects that the file
    format cannot express. model.py and model.c contain the whole model, model.tex the terms of the model, and grid.csv
    joint corrections at the nodes of a box. Errors of exported files are stated relative to `gpmodel predict` at
    unmeasured poses. Gazebo and MuJoCo read calibrated.urdf. All files have the signs and zeros of the description;
    grid.csv also has corrected joint values of the imported axes (to_controller_A1, ...), if these have others.
    """
    file = model_file(result)
    exports = load_model(file).export(box=box, nodes=nodes, setup=setup, tool=tool, seed=seed)
    deliver(exports, folder or file.parent, quiet)


CHANGED, UNDECIDED = 3, 4
"""Exit statuses of verify: the model is no longer valid or exceeds the tolerance; the check needs a further pose."""


@click.command()
@shared.model_argument
@click.argument("table", type=shared.PATH, required=False)
@click.option("--tolerance", metavar="LENGTH", help="Largest admissible error of a measured row: 0.1mm, 0.5px.")
@click.option(
    "--next", "pose_by_pose", is_flag=True, help="Propose the next pose to measure, until the check is decided."
)
@shared.in_order_option
@shared.sights_options
@click.option("--out", "folder", type=shared.PATH,
              help="Folder for the page (--next: and repaired.json), or a .json file for repaired.json.")  # fmt: skip
@shared.quiet_option
def verify(
    model: Path, table: Path | None, tolerance: str | None, pose_by_pose: bool, in_order: bool, folder: Path | None,
    quiet: bool, **sights: str | None,
) -> int:  # fmt: skip
    """Test MODEL on a TABLE measured later: the model is valid, the machine has drifted, or it is another machine.

    MODEL is a model.json of calibrate or discover. The registration, planes, points, a fixed camera, and a board on the
    table are fitted again. Ten to twenty poses are sufficient.
    The output states the error of every pose with and without the model, the expected error, and the
    change: a joint zero, a tool point or an effect. If TABLE has columns corrected_J1, ... of compensate, the machine
    was at the corrected joint values.
    Exit status: 0 if the model is valid, 3 if the model is not valid or a pose exceeds the tolerance.

    With --next, the machine is checked pose by pose. TABLE contains the measurements so far; omit TABLE before the
    first pose. The next pose is printed, with exit status 4, until the check is decided. All tests together report a
    change for at most one unchanged machine in twenty. With --out: verify.html, verify.csv, and verify.json, from which
    `certificate` makes a certificate.
    """
    if pose_by_pose:
        so_far = verify_next(model, table, tolerance=tolerance, in_order=in_order, **sights)
        written = None if folder is None else _leave(so_far, folder, model_file(model))
        if not quiet:
            echo(so_far.summary())
            if written is not None:
                echo(f"repaired model: {written}")
        passed = so_far.judged is not None and so_far.judged.passed
        return UNDECIDED if not so_far.decided else 0 if passed else CHANGED
    if table is None:
        raise InputError("missing, expected a table of poses measured after the fit; or --next", "table")
    if folder is not None and folder.suffix == ".json":
        raise InputError(f"{folder}, expected a folder; a model is repaired with --next", "out")
    with progress_line(quiet) as say:
        found = judge(
            model, table, tolerance=tolerance, in_order=in_order, progress=say, command=command_line(), **sights
        )
    deliver(found, folder, quiet)
    if folder is not None and not quiet:
        echo(f"page: {folder / 'verify.html'}")
        with suppress(InputError):
            certify(found)
            echo(f"next:\n  gpmodel certificate {shell_quoted(folder)}  its certificate")
    return 0 if found.passed else CHANGED


def _leave(found: NextCheck, out: Path, judged: Path) -> Path | None:
    """Write page and repaired model of a check into a folder, or the model alone into a .json file; return its path.

    Raises InputError if the output file is the tested model.
    """
    alone = out.suffix == ".json"
    file = out if alone else out / "repaired.json"
    if file.resolve() == judged.resolve():
        raise InputError(f"{out} is the tested model, expected another file", "out")
    if found.judged is not None and not alone:
        found.judged.report(out)
    if found.repaired is None:
        return None
    found.repaired.model.save(file)
    return file
