"""Command line `gpmodel`; the module of a command is imported when the command is called."""

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
    "import": ("import_:import_table", "Convert a file of another program to a table, a camera or a mechanism."),
    "check": ("check", "Check a measured table before any fit."),
    "calibrate": ("calibrate", "Fit registration, tool, geometry and named effects; state the gain of each."),
    "discover": ("discover", "Find effects that the model lacks, name them, confirm them on held-out poses."),
    "fleet": ("discover:fleet", "Calibrate machines of one type together: mean, spread, outlying machines."),
    "evolve": ("discover:evolve", "Evolve compensators, and count the inputs that they use."),
    "predict": ("model:predict", "Add predicted x, y, z to a table of joint values."),
    "verify": ("model:verify", "Test a model on poses measured later, and name what changed."),
    "compensate": ("model:compensate", "Compute joint values that bring the real mechanism to its targets."),
    "export": (
        "model:export",
        "Write the model as URDF, DH rows, ROS YAML, NumPy, C99, LaTeX and a grid, with errors.",
    ),
    "simulate": ("poses:simulate", "Simulate a measured table with known errors."),
    "poses": ("poses", "Choose informative measurement poses."),
    "effects": ("check:effects", "List the families of effects: source, inputs, an example."),
    "certificate": ("results:certificate", "Certify the accuracy of a machine, on one or two pages of A4."),
    "explain": ("results:explain", "Explain a finding: site, size, possible causes, what to measure."),
    "compare": ("results:compare", "State what changed between two calibrations of a machine."),
    "report": ("results:report", "Write the report's pages again from saved results."),
    "demo": ("demo", "Discover an effect in an example table, and open the report."),
    "completion": ("check:completion", "Print shell code that completes commands and options."),
}
PLUGINS = "gpmodel.commands"
DONE, DEFECT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses of gpmodel; 130 is the usual status of an interrupted program."""


PLUGIN_HELP = 60
"""Number of characters of a plug-in's help text that fit next to its name on 80 columns."""

unused_seed_option = click.Option(["--seed"], type=click.IntRange(0), expose_value=False,
                           help="Has no influence: the command draws no random numbers.")  # fmt: skip
"""Option --seed of a command that draws no random numbers."""


class CommandGroup(click.Group):
    """Command group that imports commands when called, and converts errors to a one-line message and an exit status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands, in the order of a calibration."""
        return [*COMMANDS, *sorted({e.name for e in entry_points(group=PLUGINS)} - set(COMMANDS))]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import and return the command with the given name."""
        if name in COMMANDS:
            module, _, function = COMMANDS[name][0].partition(":")
            with extra_for(f"gpmodel {name}"):
                found: click.Command = getattr(import_module(f"gpmodel.cli.{module}"), function or name)
            if not any(p.name == "seed" for p in found.params) and unused_seed_option not in found.params:
                found.params.append(unused_seed_option)
            return found
        plugin = next(iter(entry_points(group=PLUGINS, name=name)), None)
        return plugin.load() if plugin else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the arguments begin with; raise click.UsageError with similar names for an unknown
        command."""
        names = self.list_commands(ctx)
        if not ctx.resilient_parsing and not args[0].startswith("-") and args[0] not in names:
            alike = get_close_matches(args[0], names, n=2)
            meant = f"; did you mean {' or '.join(alike)}?" if alike else ""
            raise click.UsageError(f"No such command {args[0]!r}{meant}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of gpmodel commands for --help."""
        plugins = {e.name: e.load().get_short_help_str(PLUGIN_HELP) for e in entry_points(group=PLUGINS)}
        rows = [(n, COMMANDS[n][1] if n in COMMANDS else plugins[n]) for n in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def invoke(self, ctx: click.Context) -> object:
        """Run a command; in an input error, replace the name of the Python argument by the name of the option."""
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
        """Run gpmodel as a program, and exit with its status."""
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
    """Return the name of the command-line option for an argument of the Python library."""
    options = (p.opts[-1] for p in params if isinstance(p, click.Option) and p.name == argument)
    return next(options, argument)


def _end(status: int, message: str, arguments: Sequence[str] = ()) -> NoReturn:
    if "--debug" in arguments:
        traceback.print_exc()
    terminal.echo(f"gpmodel: {' '.join(message.split())}", err=True)
    sys.exit(status)


@click.group("gpmodel", cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="gpmodel")
@click.option("--debug", is_flag=True, help="Show the traceback of an error; to be given before the command.")
def main(debug: bool) -> None:
    """Find physical effects that the model of a mechanism lacks, from measured poses, and confirm them."""
