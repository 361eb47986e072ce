"""Findings, rounds and GP runs as JSON content and back, to the bit."""

import dataclasses
import math
from typing import Any

import numpy as np

from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.explore import Exploration
from gpmodel.discovery.result import Finding, Round
from gpmodel.evidence.criteria import Test, Verdict
from gpmodel.evidence.score import Score
from gpmodel.evolution.chance import Chance
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.pareto import Solution
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import Constant, NonlinearParameters
from gpmodel.formula.expression import Expression
from gpmodel.formula.program import Node, Program
from gpmodel.model.effect import Effect, Term

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
        NonlinearParameters,
        Constant,
        Effect,
        Term,
        Expression,
        Score,
        Exploration,
        Histogram,
        Solution,
        Program,
        Node,
    )
}
"""What may be read back; a name that is not here is refused."""


def encode(value: Any) -> Any:
    """JSON content of a value made of these types, arrays, tuples, lists and numbers, infinite ones as well."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: encode(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, "fields": fields}
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
