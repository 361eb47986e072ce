"""What a discovery has finished, on disk at once; going on from it gives the same numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gpmodel.discovery.encoding import decode, encode
from gpmodel.discovery.result import Finding, Round
from gpmodel.errors import InputError
from gpmodel.evolution.kept import KeptRuns, NothingKept, Number
from gpmodel.evolution.search import Evolution
from gpmodel.evolution.settings import Settings
from gpmodel.files import remove_folder, set_aside
from gpmodel.progress import Say, Teller, silent
from gpmodel.texts import read_json, seal, write_json

FOLDER = "unfinished"
REQUEST = "request.json"
SCHEMA = 5
_DIGITS = 64
_BROKEN = (ValueError, KeyError, TypeError, AttributeError, RecursionError)


class Journal(KeptRuns, Protocol):
    """Where a discovery notes what it has finished."""

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """What is finished already. Called once, before the first line of progress."""
        ...

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Called after every round with all that is finished. Raises WriteError where it cannot be written."""
        ...


class Forgetful(NothingKept):
    """A journal that keeps nothing."""

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """Nothing."""
        return [], []

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Keeps nothing."""


@dataclass(frozen=True)
class JournalFiles:
    """A journal in the subfolder `unfinished` of a folder of results, a file of sealed JSON each round and each run.

    request: JSON content of what was asked. identity: what of it, and of the content of the files it names, the numbers
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
        """Raises InputError where an unfinished search is here that was asked something else, by what differs."""
        before = unfinished(self.out)
        if before and (differing := _differing(before["identity"], self.identity)):
            raise InputError(
                f"{self.out}: its unfinished search is of something else: {'; '.join(differing)}. Put back what it "
                f"began with, or choose another folder (or remove {self.folder})"
            )

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """Findings and rounds that are finished; the request is written first. Raises InputError of refuse_another."""
        self.refuse_another()
        asked = {"schema": SCHEMA, "request": dict(self.request), "identity": dict(self.identity)}
        write_json(self.folder / REQUEST, asked)
        findings: list[Finding] = []
        rounds: list[Round] = []
        while (content := self._read(self._round(len(rounds) + 1))) is not None:
            findings = content["findings"]
            rounds.append(content["round"])
        runs = len(list(self.folder.glob("run-*.json")))
        if rounds or runs:
            Teller(self.say)(f"going on from {len(rounds)} finished rounds and {runs} finished runs in {self.folder}")
        return findings, rounds

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Write the last round; the runs it was made of are no longer needed."""
        content = {"findings": list(findings), "round": rounds[-1]}
        self._write(self._round(rounds[-1].number), content)
        for path in self.folder.glob(f"run-{rounds[-1].number}-*.json"):
            path.unlink(missing_ok=True)

    def run(self, number: Number) -> Evolution | None:
        """A finished run, without its settings."""
        content = self._read(self._run(number))
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
        self._write(self._run(number), {name: getattr(found, name) for name in names})

    def close(self) -> None:
        """Remove the files, once the results are written."""
        remove_folder(self.folder)

    @property
    def empty(self) -> bool:
        """Whether nothing is finished yet."""
        return not any(self.folder.glob("r*-*.json"))

    def _round(self, number: int) -> Path:
        return self.folder / f"round-{number}.json"

    def _run(self, number: Number) -> Path:
        return self.folder / f"run-{number[0]}-{number[1]:04d}.json"

    def _write(self, path: Path, content: Mapping[str, Any]) -> None:
        write_json(path, {"of": seal(self.identity)} | {key: encode(value) for key, value in content.items()})

    def _read(self, path: Path) -> dict[str, Any] | None:
        """The content of a file of this request; None where there is none, or it is damaged."""
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


def unfinished(out: Path) -> dict[str, Any] | None:
    """`request` and `identity` of the unfinished discovery in `out`, None where there is none.

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
        raise InputError(f"{path}: damaged ({error}), set aside as {aside.name}; start discover again") from None


def _differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What is no longer as it was, one phrase each."""
    changed = [key for key in (*before, *(k for k in now if k not in before)) if before.get(key) != now.get(key)]
    return [
        f"{key} has changed" if len(str(now.get(key))) == _DIGITS else f"{key} is {now.get(key)}, was {before.get(key)}"
        for key in changed
    ]
