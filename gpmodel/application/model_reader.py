"""model.json opened with care: its size, its schema, its seal, and the report beside it."""

from pathlib import Path

import msgspec

from gpmodel.application.model_schema import KIND, LARGEST_FILE, SCHEMA, ModelPart
from gpmodel.errors import InputError
from gpmodel.texts import SEAL, parse_json, seal

REPORT, REPORTED = "report.json", "model_sha256"


def read_part(path: Path) -> ModelPart:
    """The content of a model.json.

    Raises InputError: missing, too large, no JSON, of another kind or schema, a field that is missing or beyond its
    bounds, changed since it was written, or not the model that the report beside it tells of.
    """
    content = _content(path)
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError(f"{path}: is no model of gpmodel; expected the model.json of calibrate or discover")
    if content.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema {content.get('schema')!r}; this version of gpmodel reads schema {SCHEMA}")
    try:
        part = msgspec.convert(content, ModelPart)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$")
        raise InputError(f"{path}: {place.rstrip('`').lstrip('.') or 'model'}: {said}") from None
    if content.get(SEAL) != seal(content):
        raise InputError(f"{path}: its content is not what was written, by its {SEAL}; make it again")
    _check_report(path, content[SEAL])
    return part


def _check_report(path: Path, digest: str) -> None:
    try:
        report = parse_json((path.parent / REPORT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    said = report.get(REPORTED) if isinstance(report, dict) else None
    if said and said != digest:
        raise InputError(f"{path}: is not the model that {REPORT} beside it tells of ({REPORTED} {str(said)[:12]}…)")


def _content(path: Path) -> object:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path}: larger than {LARGEST_FILE >> 20} MB; expected a model.json")
        return parse_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a model.json") from None
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error}); expected a model.json") from None
