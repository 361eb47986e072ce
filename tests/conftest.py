"""Options and fixtures of the tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--kills N`: how often the tests of an interrupted search kill it at a random moment."""
    parser.addoption("--kills", type=int, default=1, help="Kills of a search at random moments. [default: 1]")


@pytest.fixture
def quick() -> Iterator[None]:
    """A search as small as that of `durable_cases`."""
    from durable_cases import small

    with small():
        yield


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A table for a search that is interrupted, in a folder of its own."""
    from durable_cases import measured

    return measured(tmp_path_factory.mktemp("cell"))
