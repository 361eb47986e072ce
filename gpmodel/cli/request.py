"""Request of a search, stored so that `--resume DIR` can repeat it."""

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from gpmodel._version import __version__
from gpmodel.api.model import model_file
from gpmodel.application.model_reader import REPORT
from gpmodel.characters import shell_quoted
from gpmodel.cli.options import SIGHTS
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError, WriteError
from gpmodel.files import alone_in, folder_for
from gpmodel.hierarchy.record import files_of
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.progress import Say
from gpmodel.records.unfinished import Unfinished, unfinished
from gpmodel.report.saved import LARGEST_FILE
from gpmodel.texts import parse_json, read_limited, seal

Journal = TypeVar("Journal")
NO_NUMBERS = ("resume", "folder", "quiet", "workers", "scheduler", "minutes")
"""Options that a search which is finished may be asked again with: none of its numbers would be another."""
FILES = (*SIGHTS, "model", "like")
"""Options that name a file or the folder of a result."""
CALLED = {"effects": "effect", "joints": "joint"}
"""Options by another name than their values."""
JOINT = "joint "
"""Prefix of a ball's name in front of the result of its joint."""


@dataclass(frozen=True)
class Request:
    """A command, a table or a folder of them, a mechanism, and the options by name.

    settings: what of the program itself the numbers depend on. minutes: after which no new round begins.
    """

    command: str
    table: Path
    choice: MechanismChoice
    options: Mapping[str, Any]
    settings: object
    minutes: float | None = None

    @contextlib.contextmanager
    def kept_in(
        self, out: Path | None, say: Say, journal: Callable[[Unfinished], Journal]
    ) -> Iterator[Journal | None]:  # fmt: skip
        """Keep finished parts in a `journal` until the results are written to `out`; keep nothing without it.

        No other process may write to the folder meanwhile. An interruption states how to resume; bad input before
        the first finished part leaves nothing behind.
        """
        if out is None:
            yield None
            return
        with alone_in(folder_for(out)):
            files = self._unfinished(out, say)
            files.refuse_another()
            with _resumable(self.command, files):
                files.begin()
                yield journal(files)
                files.close()

    def _unfinished(self, out: Path, say: Say) -> Unfinished:
        """Return the request as files, with paths relative to `out`, so that both can move together."""
        name = self.choice.name
        mechanism = {"mechanism": Path(name)} if Path(name).is_file() else {}
        files = {"table": self.table, **mechanism, **_named_in(self.options)}
        choice = asdict(replace(self.choice, description=None))
        request = {
            "command": self.command, "files": {kind: _relative(path, out) for kind, path in files.items()},
            "choice": choice, "options": dict(self.options), "minutes": self.minutes,
        }  # fmt: skip
        return Unfinished(out, request, self.identity(), say)

    def identity(self) -> dict[str, Any]:
        """All that the numbers depend on, files by the SHA-256 of their content. Raises InputError: no such file."""
        name = self.choice.name
        return {
            "gpmodel": __version__,
            "the command": self.command,
            **_measured(self.table),
            "the mechanism": _sha256(Path(name)) if Path(name).is_file() else name,
            "--frame": self.choice.frame,
            "--payload": self.choice.payload,
            "--payload-com": None if self.choice.payload_com is None else list(self.choice.payload_com),
            **{
                f"--{CALLED.get(name, name).replace('_', '-')}": list(value) if isinstance(value, tuple) else value
                for name, value in self.options.items()
                if name not in ("joints", *FILES)
            },
            **{f"--{kind}": _content(model_file(path)) for kind, path in _named_in(self.options).items()},
            "the search": seal({"settings": repr(self.settings)}),
        }


@dataclass(frozen=True)
class Typed:
    """Typed command: a table and a mechanism, the folder of an unfinished search to resume, or both.

    folder: value of --out.
    options: all others by name.
    result: file that a finished command leaves, next to a page.
    """

    table: Path | None
    mechanism: LoadedMechanism | None
    folder: Path | None
    resume: Path | None
    options: Mapping[str, Any]
    result: str = REPORT

    def request(self, settings: object) -> Request | None:
        """Return the request; None, with a message, if the search to resume is finished.

        Raises InputError without a table, with nothing to resume, for options that cannot change a finished search,
        or for a missing file.
        """
        ctx = click.get_current_context()
        command = str(ctx.command.name)
        choice = None if self.mechanism is None else replace(self.mechanism.choice, description=None)
        if self.resume is None:
            if self.table is None or choice is None:
                what = ctx.command.params[0].human_readable_name
                raise InputError(f"{command}: expected {what} and --mechanism M, or --resume DIR")
            options = {name: value for name, value in self.options.items() if name != "minutes"}
            return Request(command, self.table, choice, options, settings, self.options.get("minutes"))
        if self.folder is not None and self.folder.resolve() != self.resume.resolve():
            raise InputError("the results go to the folder of --resume; leave --out away", "folder")
        chosen = {n: v for n, v in self.options.items() if ctx.get_parameter_source(n) is ParameterSource.COMMANDLINE}
        given = replace(self, options=chosen)
        found = unfinished(self.resume)
        if found is None:
            done = self.resume / self.result
            if _made_by(done) != command:
                said = f"{self.resume} has no unfinished search; expected the folder of an interrupted {command}"
                raise InputError(said, "resume")
            if ignored := _typed_beside(ctx):
                raise InputError(f"{self.resume} is finished, which {', '.join(ignored)} would not change; leave "
                                 f"{'that' if len(ignored) == 1 else 'them'} away, or --resume", "resume")  # fmt: skip
            echo(f"nothing is left to do in {self.resume}; report: {done.with_suffix('.html')}")
            return None
        try:
            return given._resumed(command, self.resume, choice, found["request"], settings)
        except (LookupError, TypeError, AttributeError) as error:
            raise InputError(f"{self.resume}: its request was not written by gpmodel ({error})") from None

    def _resumed(
        self, command: str, out: Path, choice: MechanismChoice | None, content: Mapping[str, Any], settings: object
    ) -> Request:
        """The unfinished request in `out`, with what was typed again in its place."""
        if content["command"] != command:
            raise InputError(f"{out}: its unfinished search is of {content['command']}, expected one of {command}")
        files = {kind: Path(os.path.normpath(out / path)) for kind, path in content["files"].items()}
        com = content["choice"]["payload_com"]
        before = MechanismChoice(**content["choice"] | {"payload_com": None if com is None else tuple(com)})
        if "mechanism" in files:
            before = replace(before, name=str(files["mechanism"]))
        files |= {"table": self.table or files["table"]} | _named_in(self.options)
        for kind, file in files.items():
            if choice is None and not file.exists():
                raise InputError(f"{file}: the {kind} of this search is no longer there; say where it is now")
        options = {k: self.options.get(k, value) for k, value in _with_files(content["options"], files).items()}
        minutes = self.options.get("minutes", content["minutes"])
        return Request(command, files["table"], choice or before, options, settings, minutes)


@contextlib.contextmanager
def _resumable(command: str, files: Unfinished) -> Iterator[None]:
    again = f"gpmodel {command} --resume {shell_quoted(files.out)}"
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"what is finished is kept; go on with: {again}") from None
    except WriteError as error:
        raise WriteError(f"{error}, then: {again}") from None
    except InputError:
        if files.empty:
            files.close()
        raise


def _typed_beside(ctx: click.Context) -> list[str]:
    """List the options given with --resume that change numbers, by their command-line names."""
    return [
        param.human_readable_name if isinstance(param, click.Argument) else param.opts[0]
        for param in ctx.command.params
        if ctx.get_parameter_source(str(param.name)) is ParameterSource.COMMANDLINE and param.name not in NO_NUMBERS
    ]


def _made_by(result: Path) -> str | None:
    """The command that left a result, by its `kind`; None where there is none."""
    try:
        return str(parse_json(read_limited(result, LARGEST_FILE, "a result"))["kind"]).removeprefix("gpmodel ")
    except (ValueError, LookupError, TypeError):
        return None


def _named_in(options: Mapping[str, Any]) -> dict[str, Path]:
    """The files that options name: those of FILES, and the result of each ball joint that was measured alone."""
    sights = {name: Path(options[name]) for name in FILES if options.get(name)}
    joints = (said.partition("=") for said in options.get("joints") or ())
    return sights | {f"{JOINT}{ball}": Path(result) for ball, _, result in joints if result}


def _with_files(options: Mapping[str, Any], files: Mapping[str, Path]) -> dict[str, Any]:
    """The options with files where they are now."""
    joints = tuple(f"{kind.removeprefix(JOINT)}={path}" for kind, path in files.items() if kind.startswith(JOINT))
    now: dict[str, Any] = {name: str(files[name]) for name in FILES if name in files}
    return dict(options) | now | ({"joints": joints} if joints else {})


def _relative(path: Path, out: Path) -> str:
    """A path as seen from `out`, with slashes; the whole path on another drive."""
    path = path.resolve()
    with contextlib.suppress(ValueError):
        path = Path(os.path.relpath(path, out.resolve()))
    return path.as_posix()


def _measured(table: Path) -> dict[str, str]:
    """SHA-256 of a table, or of everything in a folder that says something of a fleet."""
    if table.is_dir():
        return {f"the file {path.name}": _sha256(path) for path in files_of(table)}
    return {"the table": _sha256(table)}


def _content(path: Path) -> str:
    """SHA-256 of a file; of what is none its path, which whoever reads it refuses."""
    return _sha256(path) if path.is_file() else str(path)


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a measured table") from None
