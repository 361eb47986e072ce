"""Commands `gpmodel poses` and `simulate`: choose measurement poses, simulate measurements."""

from pathlib import Path

import click

from gpmodel.api.poses import AFTER, BEFORE, CONE, MOST, Criterion, choose_poses
from gpmodel.api.simulate import simulate as measure
from gpmodel.cli.console import command_line, place_for, progress_line, write_frame
from gpmodel.cli.options import PATH, mechanism_options, out_file_option, quiet_option, seed_option
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.planning.simulate import INSTRUMENTS


@click.command()
@mechanism_options()
@click.option("--effect", "effects", multiple=True, metavar="NAME=VALUE", help="'gear_harmonic J4=20 arcsec'.")
@click.option(
    "--poses",
    default=90,
    show_default=True,
    type=click.IntRange(1),
    help="Number of random poses within the joint limits.",
)
@click.option("--noise", help="Standard deviation of one measured value. [default: 0.03mm, 0.1px, 0.002deg]")
@click.option(
    "--instrument", default="tracker", show_default=True, type=click.Choice(INSTRUMENTS), help="Simulated instrument."
)
@click.option(
    "--geometry-sigma",
    default="0mm",
    show_default=True,
    help="Standard deviation of geometric errors; 1 mm also means 1 mrad.",
)
@click.option("--input", "inputs", multiple=True, metavar="COLUMN", help="'temperature [degC]=20:30', or '=20|30'.")
@seed_option
@out_file_option
@quiet_option
def simulate(
    mechanism: LoadedMechanism, effects: tuple[str, ...], poses: int, noise: str | None, instrument: str,
    geometry_sigma: str,    inputs: tuple[str, ...], seed: int, out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Simulate a table of measured poses of a mechanism with known errors, and write the true model into the same
    folder.

    The true model (NAME.truth.json) can be used by `predict` and `compensate`. NAME of an effect is a name of the
    catalogue or slot:axis:expression. By default the simulated table is printed and no file is written.
    """
    path = place_for(out, "simulated.csv")
    made = measure(
        mechanism, effects, poses=poses, noise=noise, instrument=instrument, geometry_sigma=geometry_sigma, 
        inputs=dict(map(_input, inputs)), seed=seed,
    )  # fmt: skip
    if path is None:
        write_frame(made.to_dataframe(), None, "")
        return
    truth = made.save(path, command=command_line(), seed=seed)
    if not quiet:
        echo(f"{poses} poses in {path}, the truth in {truth}")


def _input(text: str) -> tuple[str, str]:
    header, found, values = text.partition("=")
    if not found:
        raise InputError(f"'{text}', expected 'NAME [UNIT]=A:B' or '=A|B', as in 'temperature [degC]=20:30'", "inputs")
    return header, values


@click.command()
@mechanism_options(required=False)
@click.option("-n", "--count", type=click.IntRange(1, MOST),
              help="Number of poses. [default: 40, or as many as separate the causes]")  # fmt: skip
@click.option("--after", metavar="RESULT", type=PATH, help="Result (calibrate, discover) to improve by the next poses.")
@click.option("--rejected", type=click.IntRange(1), metavar="N",
              help="With --after: poses for a decision on rejected candidate N.")  # fmt: skip
@click.option("--task", metavar="TARGETS", type=PATH,
              help="With --after: poses that lower the error at targets written as for compensate.")  # fmt: skip
@click.option("--like", metavar="DIR", type=PATH,
              help="Result folder of fleet: first poses of a further machine of the type.")  # fmt: skip
@click.option("--criterion", type=click.Choice(list(dict.fromkeys((*BEFORE, *AFTER)))),
              help="Criterion of the poses. [default: spread; with --after rivals, effect or i-optimal]")  # fmt: skip
@click.option("--above", metavar="HEIGHT", help="Lowest height of the tool in the root frame, as in 200mm.")
@click.option("--box", metavar="X:X,Y:Y,Z:Z", help="Box of the tool point: 800:1200,-200:200,300:700mm.")
@click.option("--instrument", metavar="X,Y,Z", help="Position of the instrument in the root frame: 3000,0,1500mm.")
@click.option("--normal", default=(0.0, 0.0, 1.0), nargs=3, type=float, metavar="X Y Z", show_default=True,
              help="Direction in which the reflector faces, in the measured frame.")  # fmt: skip
@click.option(
    "--cone", type=float, metavar="DEG", help=f"Half-angle of the target's acceptance cone. [default: {CONE:g}]"
)
@click.option("--tool-point", metavar="X,Y,Z", help="Tool point in the measured frame. [default: origin of the frame]")
@click.option(
    "--collisions/--no-collisions", default=True, help="Leave out poses in which the arm collides with itself."
)
@click.option(
    "--noise", default="0.03mm", show_default=True, metavar="LENGTH", help="Standard deviation of one coordinate."
)
@seed_option
@out_file_option
@quiet_option
def poses(
    mechanism: LoadedMechanism | None, count: int | None, criterion: Criterion | None, after: Path | None,
    rejected: int | None, task: Path | None, like: Path | None, above: str | None, box: str | None,
    instrument: str | None, normal: tuple[float, float, float], cone: float | None, tool_point: str | None,
    collisions: bool, noise: str, seed: int, out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Choose informative measurement poses within the joint limits, and print the precision against the number of
    poses.

    Criteria before a measurement: spread, poses as different as possible (equal distribution criterion); d-optimal (or
    observability), all geometric errors together; e-optimal, the worst determined combination of geometric errors;
    i-optimal, the predicted tool point over the workspace. --like DIR uses the prior of a known type of machine.
    Criteria after a result (--after RESULT): rivals, poses that distinguish findings and constants from alternatives;
    effect, poses that lower the standard error of the worst known effect; i-optimal; spread. --task TARGETS selects
    poses that lower the standard error of the tool point at TARGETS, and that distinguish findings from alternatives.
    Poses in which the arm collides with itself are excluded, if the URDF has geometry.
    Joint columns have the signs and zeros of the description; columns controller_A1, ... have those of the imported
    axes, if the result has others.
    """
    if after is not None and mechanism is not None:
        raise InputError(f"is already given by the model in {after}; omit --mechanism", "mechanism")
    path = place_for(out, "poses.csv", read=task)
    with progress_line(quiet) as say:
        chosen = choose_poses(
            mechanism, count, criterion=criterion, after=after, rejected=rejected, task=task, like=like, above=above,
            box=box, instrument=instrument, normal=normal, cone=cone, tool_point=tool_point, collisions=collisions,
            noise=noise, seed=seed, progress=say,
        )  # fmt: skip
    if path is None:
        echo(chosen.to_csv(), nl=False)
        return
    chosen.save(path)
    if not quiet:
        echo(f"{chosen.summary()}\n{path}")
