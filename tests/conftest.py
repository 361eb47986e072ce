"""Options of the tests."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--kills N`: how often the tests of an interrupted search kill it at a random moment."""
    parser.addoption("--kills", type=int, default=1, help="Kills of a search at random moments. [default: 1]")
