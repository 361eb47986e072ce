"""Sealed files opened with care: their size, schema and seal; and of model.json the report beside it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from gpmodel.application.model_schema import KIND, LARGEST_FILE, PLAIN, SCHEMAS, ModelPart
from gpmodel.errors import InputError
from gpmodel.texts import SEAL, parse_json, read_limited, seal

REPORT, REPORTED = "report.json", "model_sha256"
Part = TypeVar("Part")


@dataclass(frozen=True)
class Sealed(Generic[Part]):
    """A kind of sealed file. kind, schemas: as it says itself; part: its form; word, expected: in messages."""

    kind: str
    schemas: tuple[int, ...]
    part: type[Part]
    word: str
    expected: str


MODEL = Sealed(KIND, SCHEMAS, ModelPart, "model", "a model.json")


def read_part(path: Path) -> ModelPart:
    """The content of a model.json. Raises InputError as `read_sealed`, or where it is not the model that the report
    beside it tells of."""
    part, digest = read_sealed(path, MODEL)
    _check_report(path, digest)
    return part


def read_sealed(path: Path, of: Sealed[Part]) -> tuple[Part, str]:
    """The content of a sealed file and its seal.

    Raises InputError: missing, too large, no JSON, of another kind or schema, a field that is missing or beyond its
    bounds, or changed since it was written.
    """
    content = _content(path, of.expected)
    if not isinstance(content, dict) or content.get("kind") != of.kind:
        raise InputError(f"{path}: is no {of.word} of gpmodel; expected {of.expected}")
    if content.get("schema") not in of.schemas:
        read = " and ".join(map(str, of.schemas))
        raise InputError(f"{path}: schema {content.get('schema')!r}; this version of gpmodel reads schema {read}")
    try:
        part = converted(content, of.part, of.word)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if content.get(SEAL) != seal(content):
        raise InputError(f"{path}: its content is not what was written, by its {SEAL}; make it again")
    return part, str(content[SEAL])


def converted(content: object, kind: type[Part], word: str) -> Part:
    """Content in its form. Raises InputError, with `word` for the whole: a field is missing or beyond its bounds."""
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$")
        place = place.partition("`")[0]
        said = said.replace(
            f"Expected `str` matching regex {PLAIN!r}", "Expected text without quotes, backslashes, line ends"
        )
        raise InputError(f"{place.lstrip('.') or word}: {said}") from None


def _check_report(path: Path, digest: str) -> None:
    try:
        report = parse_json(read_limited(path.parent / REPORT, LARGEST_FILE, "a report"))
    except ValueError:
        return
    said = report.get(REPORTED) if isinstance(report, dict) else None
    if said and said != digest:
        raise InputError(f"{path}: is not the model that {REPORT} beside it tells of ({REPORTED} {str(said)[:12]}…)")


def _content(path: Path, expected: str) -> object:
    try:
        return parse_json(read_limited(path, LARGEST_FILE, expected))
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error}); expected {expected}") from None
