"""Finished parts of an interrupted command on disk: JSON files with a checksum of the command's inputs."""

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel.errors import InputError
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.runs import KeptRuns, Number
from gpmodel.evolution.search import Evolution
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import Constant, NonlinearParameters
from gpmodel.files import mark_damaged, remove_folder
from gpmodel.formula.expression import Expression
from gpmodel.formula.program import Node, Program
from gpmodel.model.effect import Effect, TakenUp, Term
from gpmodel.progress import Reporter, Say, silent
from gpmodel.texts import read_json, seal, write_json

_TYPES = {
    t.__name__: t
    for t in (Candidate, NonlinearParameters, Constant, Effect, TakenUp, Term, Expression, Solution, Program, Node)
}
"""Types of stored values that `decode` can create; other names are refused."""


def encode(value: Any) -> Any:
    """Convert a value to JSON content: stored types, arrays, tuples, lists, dictionaries and numbers, also infinite
    ones."""
    if isinstance(value, Node) or (dataclasses.is_dataclass(value) and not isinstance(value, type)):
        names = value._fields if isinstance(value, Node) else [f.name for f in dataclasses.fields(value)]
        return {"type": type(value).__name__, "fields": {name: encode(getattr(value, name)) for name in names}}
    match value:
        case np.ndarray():
            return {"array": encode(value.tolist())}
        case dict():
            return {"pairs": [[key, encode(v)] for key, v in value.items()]}
        case list() | tuple():
            return {"items": [encode(v) for v in value], "tuple": isinstance(value, tuple)}
        case float() if not math.isfinite(value):
            return {"float": str(value)}
        case np.generic():
            return encode(value.item())
    return value


def decode(value: Any) -> Any:
    """Convert JSON content of `encode` back to the value.
    Raises KeyError, TypeError or ValueError for other content."""
    if not isinstance(value, dict):
        return value
    if "type" in value:
        return _TYPES[value["type"]](**{k: decode(v) for k, v in value["fields"].items()})
    if "array" in value:
        return np.array(decode(value["array"]), dtype=float)
    if "pairs" in value:
        return {key: decode(v) for key, v in value["pairs"]}
    if "float" in value:
        return float(value["float"])
    items = [decode(v) for v in value["items"]]
    return tuple(items) if value["tuple"] else items


FOLDER = "unfinished"
REQUEST = "request.json"
SCHEMA = 7
_DIGITS = 64
_BROKEN = (ValueError, KeyError, TypeError, AttributeError, RecursionError)


@dataclass(frozen=True)
class Unfinished:
    """The subfolder `unfinished` of a folder of results: one file KIND-NUMBER.json for each finished part.

    request: JSON content of the command.
    identity: the inputs of the command on which the results depend, files by content. Saved files of a command with
    another identity are not used.
    say: receives a message about each damaged file, which is renamed and computed again.
    """

    out: Path
    request: Mapping[str, Any]
    identity: Mapping[str, Any]
    say: Say = silent

    @property
    def folder(self) -> Path:
        """Folder of the files of an unfinished command."""
        return self.out / FOLDER

    def refuse_another(self) -> None:
        """Raise InputError with the differences if the folder holds unfinished parts of another command."""
        before = unfinished(self.out)
        if before and (differing := _differing(before["identity"], self.identity)):
            raise InputError(
                f"{self.out}: the unfinished search has other inputs: {'; '.join(differing)}. Restore the inputs, "
                f"or choose another folder (or remove {self.folder})"
            )

    def begin(self) -> None:
        """Write the request before the first line of progress, and report the parts that are finished already.

        Raises InputError as `refuse_another`, and WriteError if the request cannot be written.
        """
        self.refuse_another()
        asked = {"schema": SCHEMA, "request": dict(self.request), "identity": dict(self.identity)}
        write_json(self.folder / REQUEST, asked)
        kinds = sorted(Counter(path.name.split("-")[0] for path in self._finished()).items())
        if kinds:
            counted = " and ".join(f"{count} finished {kind}{'s' * (count > 1)}" for kind, count in kinds)
            Reporter(self.say)(f"going on from {counted} in {self.folder}")

    def write(self, name: str, content: Mapping[str, Any]) -> None:
        """Write the record `name` with content that `encode` can convert. Raises WriteError if writing fails."""
        sealed = {"of": seal(self.identity)} | {key: encode(value) for key, value in content.items()}
        write_json(self.folder / f"{name}.json", sealed)

    def read(self, name: str) -> dict[str, Any] | None:
        """Read the record `name` of the unfinished command; return None if missing or damaged."""
        path = self.folder / f"{name}.json"
        try:
            content = read_json(path)
            if content["of"] != seal(self.identity):
                raise ValueError("of another request")
            return {key: decode(value) for key, value in content.items()}
        except FileNotFoundError:
            return None
        except (*_BROKEN, OSError) as error:
            Reporter(self.say)(f"{path}: {error}; set aside as {mark_damaged(path).name}, this part is repeated")
            return None

    def close(self) -> None:
        """Remove the files of the unfinished command once the results are written."""
        remove_folder(self.folder)

    @property
    def empty(self) -> bool:
        """True if no part of the command is finished yet."""
        return not self._finished()

    def _finished(self) -> list[Path]:
        return list(self.folder.glob("*-*.json"))


def unfinished(out: Path) -> dict[str, Any] | None:
    """Return `request` and `identity` of the unfinished command in folder `out`, None if there is none.

    Raises InputError if the file is damaged, and renames it, or if its schema is another.
    """
    path = out / FOLDER / REQUEST
    try:
        content = read_json(path)
        if content["schema"] != SCHEMA:
            raise InputError(f"{path}: schema {content['schema']}; this version resumes schema {SCHEMA}")
        return {key: dict(content[key]) for key in ("request", "identity")}
    except FileNotFoundError:
        return None
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except _BROKEN as error:
        aside = mark_damaged(path)
        raise InputError(f"{path}: damaged ({error}), set aside as {aside.name}; start the command again") from None


def _differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """List the differences between the inputs of two commands, one phrase each."""
    changed = [key for key in (*before, *(k for k in now if k not in before)) if before.get(key) != now.get(key)]
    return [_difference(key, before, now) for key in changed]


def _difference(key: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    if key not in now or key not in before:
        return f"{key} is {'new' if key in now else 'gone'}"
    changed = len(str(now[key])) == _DIGITS
    return f"{key} has changed" if changed else f"{key} is {now[key]}, was {before[key]}"


@dataclass(frozen=True)
class RunFiles(KeptRuns):
    """Finished runs of evolution, one file each."""

    files: Unfinished

    def run(self, number: Number) -> Evolution | None:
        """Read a finished run of evolution."""
        content = self.files.read(_run(number))
        names = [field.name for field in dataclasses.fields(Evolution)]
        return None if content is None else Evolution(*(content[name] for name in names))

    def keep_run(self, number: Number, found: Evolution) -> None:
        """Write the fields of an evolution run."""
        self.files.write(_run(number), vars(found))


def _run(number: Number) -> str:
    return f"run-{number[0]}-{number[1]:04d}"
