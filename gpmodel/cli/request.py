"""What was asked of `gpmodel discover`, kept so that it can be asked again."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gpmodel._version import __version__
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.journal import JournalFiles, unfinished
from gpmodel.discovery.search import Search
from gpmodel.errors import InputError
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.progress import Say
from gpmodel.texts import seal


@dataclass(frozen=True)
class Request:
    """A table, a mechanism, and the options of `discover` by name. minutes: after which no new round begins."""

    table: Path
    choice: MechanismChoice
    options: Mapping[str, Any]
    minutes: float | None = None

    def search(self) -> Search:
        """How hard to look."""
        return Search(runs=self.options["runs"], stop_after=None if self.minutes is None else 60 * self.minutes)

    def journal(self, out: Path, say: Say) -> JournalFiles:
        """Where its progress is kept: paths relative to `out`, so that both can move together."""
        files = {"table": _relative(self.table, out)}
        name = self.choice.name
        if Path(name).is_file():
            files["mechanism"] = _relative(Path(name), out)
        choice = asdict(replace(self.choice, description=None))
        request = {"files": files, "choice": choice, "options": dict(self.options), "minutes": self.minutes}
        return JournalFiles(out, request, self.identity(), say)

    def identity(self) -> dict[str, Any]:
        """All that the numbers depend on, files by the SHA-256 of their content. Raises InputError: no such file."""
        name, search = self.choice.name, replace(self.search(), stop_after=None)
        return {
            "gpmodel": __version__,
            "the table": _sha256(self.table),
            "the mechanism": _sha256(Path(name)) if Path(name).is_file() else name,
            "--frame": self.choice.frame,
            "--payload": self.choice.payload,
            "--payload-com": None if self.choice.payload_com is None else list(self.choice.payload_com),
            **{f"--{name.replace('_', '-')}": value for name, value in self.options.items()},
            "the search": seal({"search": repr(search), "criteria": repr(Criteria())}),
        }


def resumed(out: Path, table: Path | None, choice: MechanismChoice | None, given: Mapping[str, Any]) -> Request | None:
    """The request of the unfinished search in `out`, with what was given again in its place; None where it is finished.

    Raises InputError where there is nothing to resume, or a file is no longer there.
    """
    found = unfinished(out)
    if found is None:
        if (out / "report.json").exists():
            return None
        raise InputError(f"{out} has no unfinished search; expected the folder of an interrupted discover", "resume")
    content = found["request"]
    files = {kind: out / Path(*path.split("/")) for kind, path in content["files"].items()}
    com = content["choice"]["payload_com"]
    before = MechanismChoice(**content["choice"] | {"payload_com": None if com is None else tuple(com)})
    if "mechanism" in files:
        before = replace(before, name=os.path.normpath(files["mechanism"]))
    path = table or Path(os.path.normpath(files["table"]))
    for kind, file, needed in (("table", path, True), ("mechanism", Path(before.name), "mechanism" in files)):
        if needed and choice is None and not file.is_file():
            raise InputError(f"{file}: the {kind} of this search is no longer there; say where it is now")
    options = {name: given.get(name, value) for name, value in content["options"].items()}
    return Request(path, choice or before, options, given.get("minutes", content["minutes"]))


def _relative(path: Path, out: Path) -> str:
    """A path as seen from `out`, with slashes."""
    return Path(os.path.relpath(path.resolve(), out.resolve())).as_posix()


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a measured table") from None
