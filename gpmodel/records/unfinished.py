"""What a long command has finished, on disk at once: sealed JSON beside what was asked."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gpmodel.errors import InputError
from gpmodel.files import remove_folder, set_aside
from gpmodel.progress import Say, Teller, silent
from gpmodel.records.encoding import decode, encode
from gpmodel.texts import read_json, seal, write_json

FOLDER = "unfinished"
REQUEST = "request.json"
SCHEMA = 6
_DIGITS = 64
_BROKEN = (ValueError, KeyError, TypeError, AttributeError, RecursionError)


@dataclass(frozen=True)
class Unfinished:
    """The subfolder `unfinished` of a folder of results, a file for each thing that is finished: KIND-NUMBER.json.

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
        """Raises InputError where something unfinished is here that was asked otherwise, by what differs."""
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
        """What was written for this request; None where there is nothing, or it is damaged."""
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

    def forget(self, names: str) -> None:
        """Remove what is no longer needed. names: a pattern, as in run-1-*."""
        for path in self.folder.glob(f"{names}.json"):
            path.unlink(missing_ok=True)

    def close(self) -> None:
        """Remove the files, once the results are written."""
        remove_folder(self.folder)

    @property
    def empty(self) -> bool:
        """Whether nothing is finished yet."""
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
    """What is no longer as it was, one phrase each."""
    changed = [key for key in (*before, *(k for k in now if k not in before)) if before.get(key) != now.get(key)]
    return [_difference(key, before, now) for key in changed]


def _difference(key: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    if key not in now or key not in before:
        return f"{key} is {'new' if key in now else 'gone'}"
    changed = len(str(now[key])) == _DIGITS
    return f"{key} has changed" if changed else f"{key} is {now[key]}, was {before[key]}"
