"""Tables of instances: a few in the default suite, all of them in the long one."""

from collections.abc import Iterable
from typing import Any

import pytest


def some(instances: Iterable[Any], *short: object) -> list[Any]:
    """All instances, those that are not `short` marked as long."""
    every = list(instances)
    assert all(one in every for one in short), short
    return [one if one in short else pytest.param(one, marks=pytest.mark.long) for one in every]
