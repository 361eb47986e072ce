"""Finished parts of a long command on disk: sealed JSON with its request."""

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
from gpmodel.evolution.settings import Settings
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import Constant, NonlinearParameters
from gpmodel.files import remove_folder, set_aside
from gpmodel.formula.expression import Expression
from gpmodel.formula.program import Node, Program
from gpmodel.model.effect import Effect, TakenUp, Term
from gpmodel.progress import Say, Teller, silent
from gpmodel.texts import read_json, seal, write_json

_TYPES = {
    t.__name__: t
    for t in (Candidate, NonlinearParameters, Constant, Effect, TakenUp, Term, Expression, Solution, Program, Node)
}
"""Types that may be read back; other names are refused."""


def encode(value: Any) -> Any:
    """JSON content of a value made of these types, arrays, tuples, lists and numbers, infinite ones as well."""
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
    """The value again. Raises KeyError, TypeError or ValueError where it is none that `encode` wrote."""
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
    """The subfolder `unfinished` of a folder of results, a file for each thing that is finished: KIND-NUMBER.json.

    request: JSON content of the command. identity: what of it, and of the content of the files it names, the numbers
    depend on; only files written for the same are read. A file that is damaged is named through `say` and set aside,
    and what it held is done again.
    """

    out: Path
    request: Mapping[str, Any]
    identity: Mapping[str, Any]
    say: Say = silent

    @property
    def folder(self) -> Path:
        """Where the files are."""
        return self.out / FOLDER

    def refuse_another(self) -> None:
        """Raises InputError for the unfinished parts of another command, with the differences."""
        before = unfinished(self.out)
        if before and (differing := _differing(before["identity"], self.identity)):
            raise InputError(
                f"{self.out}: its unfinished search is of something else: {'; '.join(differing)}. Put back what it "
                f"began with, or choose another folder (or remove {self.folder})"
            )

    def begin(self) -> None:
        """Write the request, before the first line of progress; say what is finished already.

        Raises InputError of refuse_another, WriteError where it cannot be written.
        """
        self.refuse_another()
        asked = {"schema": SCHEMA, "request": dict(self.request), "identity": dict(self.identity)}
        write_json(self.folder / REQUEST, asked)
        kinds = sorted(Counter(path.name.split("-")[0] for path in self._finished()).items())
        if kinds:
            counted = " and ".join(f"{count} finished {kind}{'s' * (count > 1)}" for kind, count in kinds)
            Teller(self.say)(f"going on from {counted} in {self.folder}")

    def write(self, name: str, content: Mapping[str, Any]) -> None:
        """Write what `encode` knows. Raises WriteError where it cannot be written."""
        sealed = {"of": seal(self.identity)} | {key: encode(value) for key, value in content.items()}
        write_json(self.folder / f"{name}.json", sealed)

    def read(self, name: str) -> dict[str, Any] | None:
        """Read the record of this request; None if it is missing or damaged."""
        path = self.folder / f"{name}.json"
        try:
            content = read_json(path)
            if content["of"] != seal(self.identity):
                raise ValueError("of another request")
            return {key: decode(value) for key, value in content.items()}
        except FileNotFoundError:
            return None
        except (*_BROKEN, OSError) as error:
            Teller(self.say)(f"{path}: {error}; set aside as {set_aside(path).name}, what it held is done again")
            return None

    def close(self) -> None:
        """Remove the files, once the results are written."""
        remove_folder(self.folder)

    @property
    def empty(self) -> bool:
        """True if nothing is finished yet."""
        return not self._finished()

    def _finished(self) -> list[Path]:
        return list(self.folder.glob("*-*.json"))


def unfinished(out: Path) -> dict[str, Any] | None:
    """`request` and `identity` of what is unfinished in `out`, None where nothing is.

    Raises InputError where the file is damaged, which is set aside, or of another schema.
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
        aside = set_aside(path)
        raise InputError(f"{path}: damaged ({error}), set aside as {aside.name}; start the command again") from None


def _differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """List the changes, one phrase each."""
    changed = [key for key in (*before, *(k for k in now if k not in before)) if before.get(key) != now.get(key)]
    return [_difference(key, before, now) for key in changed]


def _difference(key: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    if key not in now or key not in before:
        return f"{key} is {'new' if key in now else 'gone'}"
    changed = len(str(now[key])) == _DIGITS
    return f"{key} has changed" if changed else f"{key} is {now[key]}, was {before[key]}"


@dataclass(frozen=True)
class RunFiles(KeptRuns):
    """A file each run."""

    files: Unfinished

    def run(self, number: Number) -> Evolution | None:
        """Read a finished run, without its settings."""
        content = self.files.read(_run(number))
        if content is None:
            return None
        front, best = content["front"], content["best"]
        counts = best.program.input_counts, best.program.operator_counts
        return Evolution(
            front, best, content["history"], *counts, content["evaluations"], content["seconds"], Settings()
        )

    def keep_run(self, number: Number, found: Evolution) -> None:
        """Write what is needed of a run."""
        names = ("front", "best", "history", "evaluations", "seconds")
        self.files.write(_run(number), {name: getattr(found, name) for name in names})


def _run(number: Number) -> str:
    return f"run-{number[0]}-{number[1]:04d}"
