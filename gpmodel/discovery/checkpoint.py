"""What an interrupted discovery has finished, as text; resuming repeats the rest to the same numbers."""

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.criteria import Test, Verdict
from gpmodel.discovery.explore import Exploration
from gpmodel.discovery.result import Finding, Round
from gpmodel.discovery.score import Score
from gpmodel.errors import InputError
from gpmodel.evolution.chance import Chance
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.families.candidate import Candidate, Inner
from gpmodel.files import write_text
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, Term

NAME = "progress.json"
SCHEMA = 4
_TYPES = {
    t.__name__: t
    for t in (
        Finding,
        Round,
        Hypothesis,
        Verdict,
        Test,
        Chance,
        Candidate,
        Inner,
        Effect,
        Term,
        Expression,
        Score,
        Exploration,
        Histogram,
    )
}


def save(folder: Path, request: dict[str, Any], findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
    """Write what is finished to `folder`. request: what was asked, to ask it again."""
    content = {
        "schema": SCHEMA,
        "request": request,
        "findings": _encode(list(findings)),
        "rounds": _encode(list(rounds)),
    }
    write_text(folder / NAME, json.dumps(content))


def load(folder: Path) -> tuple[dict[str, Any], list[Finding], list[Round]]:
    """Read it back. Raises InputError when there is nothing to resume or it is damaged."""
    path = folder / NAME
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["schema"] != SCHEMA:
            raise InputError(f"{path}: schema {content['schema']}; this version resumes schema {SCHEMA}")
        return content["request"], _decode(content["findings"]), _decode(content["rounds"])
    except OSError:
        raise InputError(f"{folder} has no {NAME}; expected the folder of an interrupted discover", "resume") from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: damaged ({error}); start discover again") from None


def _encode(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _encode(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, "fields": fields}
    match value:
        case np.ndarray():
            return {"array": _encode(value.tolist())}
        case dict():
            return {"pairs": [[key, _encode(v)] for key, v in value.items()]}
        case list() | tuple():
            return {"items": [_encode(v) for v in value], "tuple": isinstance(value, tuple)}
        case float() if not math.isfinite(value):
            return {"float": str(value)}
        case np.generic():
            return _encode(value.item())
    return value


def _decode(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if "type" in value:
        return _TYPES[value["type"]](**{k: _decode(v) for k, v in value["fields"].items()})
    if "array" in value:
        return np.array(_decode(value["array"]), dtype=float)
    if "pairs" in value:
        return {key: _decode(v) for key, v in value["pairs"]}
    if "float" in value:
        return float(value["float"])
    items = [_decode(v) for v in value["items"]]
    return tuple(items) if value["tuple"] else items
