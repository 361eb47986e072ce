"""Test that candidates that fail given all others are eliminated, the weaker half at a time."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gpmodel.discovery.acceptance import eliminate
from gpmodel.evidence.criteria import Test, Verdict

NATS = {"a": 90.0, "b": 50.0, "c": 20.0, "d": 10.0}
"""Gain of each finding."""


def judged(rule: Mapping[str, frozenset[str]], chance: Mapping[str, bool]) -> Any:
    """A judge by whom a finding fails beside any of those that the rule names for it."""

    def judge(calibration: frozenset[str], asked: Mapping[str, str]) -> dict[str, Any]:
        out = {}
        for name in asked:
            tests = (
                Test("chance", 0.0, 0.01, chance.get(name, True)),
                Test("nats", NATS[name], 5.0, not (rule.get(name, frozenset()) & (calibration - {name}))),
            )
            verdict = Verdict(tests)
            out[name] = SimpleNamespace(
                verdict=verdict, accepted=verdict.accepted, score=SimpleNamespace(nats=NATS[name])
            )
        return out

    return judge


def fit(candidates: Sequence[str], start: frozenset[str]) -> frozenset[str]:
    return frozenset(candidates)


@pytest.mark.parametrize(
    ("rule", "chance", "standing"),
    [
        ({}, {}, "abcd"),
        ({"b": "a", "a": "b"}, {}, "acd"),
        ({"a": "d", "b": "d", "d": "c"}, {}, "abc"),
        ({"a": "d", "b": "d"}, {"d": False}, "abc"),
        ({"c": "b", "b": "a"}, {}, "ad"),
    ],
)
def test_the_weakest_that_fails_goes_first(rule: dict[str, str], chance: dict[str, bool], standing: str) -> None:
    whole = {name: frozenset(others) for name, others in rule.items()}
    offered = cast(Any, {name: name for name in NATS})
    verdicts, calibration = eliminate(offered, cast(Any, frozenset(NATS)), judged(whole, chance), cast(Any, fit))
    assert set(cast(Any, calibration)) == set(standing)
    assert set(verdicts) == set(NATS)
    for name in standing:
        assert verdicts[name].accepted
