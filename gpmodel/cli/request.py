"""Save the finished parts of a long command in its folder; `--resume DIR` continues from the saved parts."""

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click

from gpmodel._version import __version__
from gpmodel.api.model import model_file
from gpmodel.application.model_reader import REPORT
from gpmodel.characters import shell_quoted
from gpmodel.cli.options import PATH, SIGHTS
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError, WriteError
from gpmodel.files import folder_for, locked_folder
from gpmodel.hierarchy.record import files_of, fleet_file
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.progress import Say
from gpmodel.records.unfinished import Unfinished, unfinished
from gpmodel.report.saved import LARGEST_FILE
from gpmodel.texts import parse_json, read_limited, seal

Journal = TypeVar("Journal")
Command = TypeVar("Command", bound=Callable[..., object])
FILES = ("table", "tables", "mechanism", "model", "like", *SIGHTS)
"""Command parameters whose value is a file or a folder."""
NO_NUMBERS = ("folder", "quiet", "workers", "scheduler", "minutes")
"""Command parameters that do not influence the result of a search."""
JOINT = "joint "
"""Prefix of a ball joint's name as the key of its result file."""


def resume_option(result: str = REPORT) -> Callable[[Command], Command]:
    """Add --resume to a command. result: name of the data file that a finished command writes."""
    return click.option(
        "--resume", type=PATH, is_eager=True, expose_value=False, callback=partial(_resume, result),
        help="Folder of an interrupted run to resume; no other argument is needed.",
    )  # fmt: skip


def _resume(result: str, ctx: click.Context, _: click.Parameter, folder: Path | None) -> None:
    """Set the saved parameters of the interrupted command as defaults; exit if the command has finished."""
    if folder is None:
        return
    command, found = str(ctx.command.name), unfinished(folder)
    if found is None:
        done = folder / result
        if _made_by(done) != command:
            message = f"{folder} has no unfinished search; expected the folder of an interrupted {command}"
            raise InputError(message, "resume")
        echo(f"nothing is left to do in {folder}; report: {done.with_suffix('.html')}")
        ctx.exit()
    try:
        typed = found["request"]
        if typed["command"] != command:
            raise InputError(f"{folder}: the unfinished run belongs to {typed['command']}, expected a run of {command}")
        files = {kind: os.path.normpath(folder / path) for kind, path in typed["files"].items()}
        joints = [f"{kind.removeprefix(JOINT)}={path}" for kind, path in files.items() if kind.startswith(JOINT)]
        ctx.default_map = {**typed["options"], **files, **({"joints": joints} if joints else {}), "folder": folder}
    except (LookupError, TypeError, AttributeError) as error:
        raise InputError(
            f"{folder}: the saved command of the unfinished run was not written by gpmodel ({error})"
        ) from None


@contextlib.contextmanager
def keeping(
    journal: Callable[[Unfinished], Journal], mechanism: LoadedMechanism, settings: object, say: Say
) -> Iterator[Journal | None]:  # fmt: skip
    """Yield a `journal` that saves the finished parts of the current command; None without --out.

    settings: values that influence the result but have no option. During the command the folder is locked.
    An interruption prints how to resume; an input error before the first finished part leaves no file.
    """
    ctx = click.get_current_context()
    params, out = ctx.params, ctx.params["folder"]
    if out is None:
        yield None
        return
    if ctx.default_map and folder_for(out).resolve() != Path(ctx.default_map["folder"]).resolve():
        raise InputError("the results go to the folder of --resume; omit --out", "folder")
    with locked_folder(folder_for(out)):
        files = _files(params)
        options = {k: v for k, v in params.items() if v is not None and k not in files and k not in NO_NUMBERS[:-1]}
        request = {
            "command": ctx.command.name, "files": {kind: _relative(path, out) for kind, path in files.items()},
            "options": options,
        }  # fmt: skip
        parts = Unfinished(out, request, _identity(ctx, mechanism, settings), say)
        parts.refuse_another()
        with _resumable(str(ctx.command.name), parts):
            parts.begin()
            yield journal(parts)
            parts.close()


def _identity(ctx: click.Context, mechanism: LoadedMechanism, settings: object) -> dict[str, Any]:
    """Return all inputs of a command, with files by SHA-256 checksum; raise InputError for a missing file."""
    files, choice = _files(ctx.params), mechanism.choice
    label = {str(p.name): p.opts[0] if isinstance(p, click.Option) else f"the {p.name}" for p in ctx.command.params}
    values = {k: v for k, v in ctx.params.items() if k not in (*FILES, *NO_NUMBERS, "joints")}
    content: dict[str, str] = {}
    for kind, path in files.items():
        name = label.get(kind, f"--{kind}")
        if ctx.default_map and not path.exists():
            raise InputError(f"{path}: {name} of this search is missing; expected the option with the new path")
        if kind == "tables":
            content |= {f"the file {table.name}": _sha256(table) for table in files_of(path)}
        elif kind != "mechanism":
            inside = fleet_file(path) if kind == "like" else model_file(path)
            content[name] = _sha256(inside) if inside.is_file() else str(inside)
    return {
        "gpmodel": __version__,
        "the command": ctx.command.name,
        "the mechanism": seal({"": choice.description}) if choice.description else choice.name,
        **{label[name]: list(value) if isinstance(value, tuple) else value for name, value in values.items()},
        **content,
        "the search": seal({"settings": repr(settings)}),
    }


@contextlib.contextmanager
def _resumable(command: str, files: Unfinished) -> Iterator[None]:
    again = f"gpmodel {command} --resume {shell_quoted(files.out)}"
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"finished parts are saved; resume with: {again}") from None
    except WriteError as error:
        raise WriteError(f"{error}, then: {again}") from None
    except InputError:
        if files.empty:
            files.close()
        raise


def _made_by(result: Path) -> str | None:
    """Return the command that wrote a result, from the key `kind` of the result; None without a result."""
    try:
        return str(parse_json(read_limited(result, LARGEST_FILE, "a result"))["kind"]).removeprefix("gpmodel ")
    except (ValueError, LookupError, TypeError):
        return None


def _files(params: Mapping[str, Any]) -> dict[str, Path]:
    """Return the files named by the parameters FILES, and the result file of each separately measured ball joint."""
    named = {name: Path(params[name]) for name in FILES if params.get(name)}
    if "mechanism" in named and not named["mechanism"].is_file():
        del named["mechanism"]
    joints = (said.partition("=") for said in params.get("joints") or ())
    return named | {f"{JOINT}{ball}": Path(result) for ball, _, result in joints if result}


def _relative(path: Path, out: Path) -> str:
    """Return a path relative to the folder `out`, with slashes; if the path is on another drive, the absolute path."""
    path = path.resolve()
    with contextlib.suppress(ValueError):
        path = Path(os.path.relpath(path, out.resolve()))
    return path.as_posix()


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a measured table") from None
