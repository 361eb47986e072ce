"""Choose a few test instances in the default suite, and all in the long suite."""

from collections.abc import Iterable
from typing import Any

import pytest


def some(instances: Iterable[Any], *short: object) -> list[Any]:
    """All instances, those that are not `short` marked as long."""
    every = list(instances)
    assert all(one in every for one in short), short
    marks = [() if one in short else pytest.mark.long for one in every]
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=m) for one, m in zip(every, marks, strict=True)
    ]
