"""Read untrusted files within size limits: text, TOML, JSON, and JSON with a checksum."""

import hashlib
import json
import math
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gpmodel.characters import steers
from gpmodel.errors import InputError
from gpmodel.files import plain, write_text


def read_limited(path: Path, largest: int, expected: str) -> bytes:
    """Return the bytes of a regular file of at most `largest` bytes.

    Raises InputError if the file cannot be read, is a device or a pipe, or is larger; the message says what was
    `expected`.
    """
    if "\0" in str(path):
        raise InputError(f"{str(path)!r}: a null character in a file name; expected {expected}")
    try:
        kind = path.stat().st_mode
        if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind):
            raise InputError(f"{path}: a device or a pipe, not a regular file; expected {expected}")
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected {expected}") from None
    if len(content) > largest:
        raise InputError(f"{path}: larger than {largest >> 20} MB; expected {expected} of less")
    return content


def read_text(path: Path, largest: int, expected: str) -> str:
    """Return the text of a UTF-8 file of at most `largest` bytes, without a byte-order mark.

    Raises InputError if the file cannot be read, is too large or is not UTF-8; the message says what was `expected`.
    """
    try:
        return read_limited(path, largest, expected).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8 ({error.reason}); expected {expected}") from None


SEAL = "sha256"
LARGEST_TOML = 1 << 20
"""Largest size of a TOML file, bytes. An arm's description has a few thousand bytes."""
LARGEST_INTEGER = 2**63
"""Largest accepted integer in TOML. Python reads integers of hundreds of digits, which no float can hold."""


def seal(content: Mapping[str, object]) -> str:
    """Return the SHA-256 checksum of JSON content without its checksum entry. The checksum does not depend on the
    layout of the file."""
    bare = {key: value for key, value in content.items() if key != SEAL}
    text = json.dumps(plain(bare), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write JSON content with its checksum. Raises WriteError if the file cannot be written."""
    write_text(path, json.dumps({**content, SEAL: seal(content)}))


def read_json(path: Path) -> dict[str, Any]:
    """Return the content of a JSON file with a checksum.

    Raises OSError if the file cannot be read, ValueError if the checksum does not match.
    """
    content = parse_json(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.pop(SEAL, None) != seal(content):
        raise ValueError("its content is not what was written")
    return content


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text. Raises ValueError for invalid JSON, too deep nesting, or a number that is not finite."""
    try:
        return json.loads(text, parse_constant=_finite, parse_float=_finite)
    except RecursionError:
        raise ValueError("nested too deep") from None


def read_toml(path: Path, expected: str) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises InputError if the file cannot be read, is too large or is not TOML; the message says what was `expected`.
    """
    try:
        content = tomllib.loads(read_text(path, LARGEST_TOML, expected))
        _check_values(content)
        return content
    except InputError:
        raise
    except RecursionError:
        raise InputError(f"{path}: nested too deep; expected {expected}") from None
    except ValueError as error:
        raise InputError(f"{path}: is no TOML ({error}); expected {expected}") from None


def _check_values(value: object) -> None:
    """Raise ValueError for a text or key with line breaks or control characters, or an integer that is too large."""
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise ValueError("an integer that is too large")
    if isinstance(value, str) and steers(value):
        raise ValueError(f"control characters in {value[:40]!a}")
    for part in (*value, *value.values()) if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_values(part)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no finite number")
    return value


def toml_text(content: Mapping[str, object], path: str = "") -> str:
    """Write nested tables as TOML. Values may be texts, numbers and lists."""
    own = [f"{key} = {json.dumps(value)}" for key, value in content.items() if not isinstance(value, Mapping)]
    lines = [f"[{path}]", *own, ""] if path and own else own
    parts = [toml_text(v, f"{path}.{k}" if path else k) for k, v in content.items() if isinstance(v, Mapping)]
    return "\n".join(lines) + "".join(f"\n{part}" if lines else part for part in parts) + ("\n" if own else "")
