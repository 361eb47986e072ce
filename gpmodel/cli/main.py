"""The command line: `gpmodel`, its commands imported only when called."""

import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import NoReturn

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ["MPLBACKEND"] = "agg"  # no window is shown; a missing backend would fail

import click  # noqa: E402

from gpmodel._version import __version__  # noqa: E402
from gpmodel.cli import terminal  # noqa: E402
from gpmodel.errors import GpModelError, InputError  # noqa: E402
from gpmodel.extras import extra_for  # noqa: E402

COMMANDS = {
    "import": ("import_:import_table", "Turn a file of another program into a table, a camera or a mechanism."),
    "check": ("check", "Judge a measured table before anything is fitted to it."),
    "calibrate": ("calibrate", "Fit registration, tool, geometry and named effects; before and after."),
    "discover": ("discover", "Find what the model is missing, name it, prove it on poses never seen."),
    "fleet": ("fleet", "Many machines of one type: what they share, how they spread, who stands out."),
    "evolve": ("evolve", "Evolve compensators and the histogram of the inputs they refer to."),
    "predict": ("model:predict", "Add predicted x, y, z to a table of joint values."),
    "verify": ("model:verify", "Does the model still hold, by poses measured afterwards? What changed?"),
    "compensate": ("model:compensate", "Corrected joint values that make the real mechanism reach its targets."),
    "export": (
        "model:export",
        "The model as URDF, DH rows, ROS YAML, NumPy, C99, LaTeX and a grid, with their errors.",
    ),
    "simulate": ("poses:simulate", "A measured table with known truth."),
    "poses": ("poses", "Measurement poses worth taking."),
    "effects": ("check:effects", "The families of effects: source, inputs, an example."),
    "certificate": ("results:certificate", "How accurate the machine is, on one or two sides of A4."),
    "explain": ("results:explain", "A finding in words: place, size, cause, what to measure."),
    "compare": ("results:compare", "What changed between two calibrations of a machine."),
    "report": ("results:report", "Write the report's pages again from saved results."),
    "demo": ("demo", "The main job on a shipped table, to the opened report."),
    "completion": ("check:completion", "What makes the shell complete commands and options."),
}
PLUGINS = "gpmodel.commands"
DONE, DEFECT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses of the program; shells give an interrupted one 130."""


PLUGIN_HELP = 60
"""Characters of a plugin's help beside its name: what 80 columns leave."""


class CommandGroup(click.Group):
    """A group that imports a command when it is called, and turns every error into one line and a status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, in the order of a calibration."""
        return [*COMMANDS, *sorted({e.name for e in entry_points(group=PLUGINS)} - set(COMMANDS))]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """The command of that name, loaded only now."""
        if name in COMMANDS:
            module, _, function = COMMANDS[name][0].partition(":")
            with extra_for(f"gpmodel {name}"):
                found: click.Command = getattr(import_module(f"gpmodel.cli.{module}"), function or name)
                return found
        plugin = next(iter(entry_points(group=PLUGINS, name=name)), None)
        return plugin.load() if plugin else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that the words begin with. Raises click.UsageError for an unknown one, with those like it."""
        names = self.list_commands(ctx)
        if not ctx.resilient_parsing and not args[0].startswith("-") and args[0] not in names:
            alike = get_close_matches(args[0], names, n=2)
            meant = f"; did you mean {' or '.join(alike)}?" if alike else ""
            raise click.UsageError(f"No such command {args[0]!r}{meant}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands by group, for --help."""
        plugins = {e.name: e.load().get_short_help_str(PLUGIN_HELP) for e in entry_points(group=PLUGINS)}
        rows = [(n, COMMANDS[n][1] if n in COMMANDS else plugins[n]) for n in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def invoke(self, ctx: click.Context) -> object:
        """Run the command; errors of input end it with one line."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stopped:
            raise click.Abort(*stopped.args) from None
        except ModuleNotFoundError:
            with extra_for(f"gpmodel {ctx.invoked_subcommand}"):
                raise
        except InputError as error:
            command = self.get_command(ctx, ctx.invoked_subcommand or "")
            raise InputError(error.said, option_of(error.argument, command.params if command else ())) from error

    def main(self, args: Sequence[str] | None = None, prog_name: str | None = None, **extra: object) -> NoReturn:  # type: ignore[override]
        """Run as a program, and exit."""
        arguments = list(sys.argv[1:] if args is None else args) or ["--help"]
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # as for Ctrl-C, to remove temporary files
        terminal.begin()
        logging.getLogger("matplotlib").setLevel(logging.ERROR)  # no warning about a read-only home folder
        try:
            status = super().main(arguments, prog_name or "gpmodel", standalone_mode=False)
            ended = status if isinstance(status, int) else DONE
            if lost := terminal.failed():
                _end(ended or BAD_INPUT, f"standard output: {lost}; files are written, what was printed is incomplete")
            sys.exit(ended)
        except click.Abort as stopped:
            _end(INTERRUPTED, "; ".join(["interrupted", *stopped.args]))
        except click.exceptions.NoArgsIsHelpError as asked:
            terminal.echo(asked.format_message())
            sys.exit(DONE)
        except click.ClickException as error:
            where = (
                f"; see {error.ctx.command_path} --help" if isinstance(error, click.UsageError) and error.ctx else ""
            )
            _end(BAD_INPUT, f"{error.format_message().rstrip('.')}{where}", arguments)
        except GpModelError as error:
            _end(BAD_INPUT, str(error), arguments)
        except MemoryError as error:
            said = f" ({error})" if str(error) else ""
            _end(BAD_INPUT, f"not enough memory{said}; expected fewer poses or columns, or a larger machine", arguments)
        except OSError as error:
            _end(BAD_INPUT, str(InputError(f"'{error.filename or ''}': {error.strerror or error}")), arguments)
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}"
            said = f"{type(error).__name__}: {error}".rstrip(": ")
            _end(DEFECT, f"a defect of gpmodel, not of your input: {said} ({place}); --debug shows more", arguments)


def option_of(argument: str, params: Sequence[click.Parameter]) -> str:
    """Return the option name of a library argument."""
    options = (p.opts[-1] for p in params if isinstance(p, click.Option) and p.name == argument)
    return next(options, argument)


def _end(status: int, message: str, arguments: Sequence[str] = ()) -> NoReturn:
    if "--debug" in arguments:
        traceback.print_exc()
    terminal.echo(f"gpmodel: {' '.join(message.split())}", err=True)
    sys.exit(status)


@click.group("gpmodel", cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="gpmodel")
@click.option("--debug", is_flag=True, help="Show the traceback of an error; before the command's name.")
def main(debug: bool) -> None:
    """Measured poses in; out comes what the model of the mechanism is missing: named, added, proven."""
