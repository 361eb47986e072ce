"""Options and fixtures of the tests."""

import os
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("whatever the machine's load", deadline=None)
settings.load_profile("whatever the machine's load")

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
"""One thread a worker, as the program has it: threads of small products wait for each other most of the time."""


def pytest_configure(config: pytest.Config) -> None:
    """Files are dealt to the workers as they come: those with the most tests, which come first otherwise, are not those
    that take longest, and a long one left to the end keeps the others waiting."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


SHARED = re.compile(r"^from (loop_cases|report_runs) import", re.MULTILINE)
EVOLVES = re.compile(r"gpmodel\.evolution|\bdiscover\b|\bevolve\b")


@cache
def reads_the_loop(file: Path) -> bool:
    """Return whether tests of a file use runs of the whole loop that other files use too."""
    return SHARED.search(file.read_text(encoding="utf-8")) is not None


@cache
def evolves(file: Path) -> bool:
    """Return whether tests of a file may run compiled kernels."""
    return EVOLVES.search(file.read_text(encoding="utf-8")) is not None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all instances but the first ones as long where a test asks for it, and order the files.

    Files that share runs come first: together they take longest. The others that evolve come last: meanwhile one worker
    has compiled the kernels, which two would compile side by side."""
    seen = Counter[str]()
    for item in items:
        if first := item.get_closest_marker("first"):
            test = item.nodeid.partition("[")[0]
            if seen[test] >= first.args[0]:
                item.add_marker(pytest.mark.long)
            seen[test] += 1
    items.sort(key=lambda item: (not reads_the_loop(item.path), evolves(item.path)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """`--dist loadfile`, with those files dealt to one worker: another would make each of the runs again."""
    from xdist.scheduler import LoadFileScheduling

    class Dealt(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "runs of the loop" if reads_the_loop(config.rootpath / file) else str(file)

    return Dealt(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--kills N`: how often the tests of an interrupted search kill it at a random moment."""
    parser.addoption("--kills", type=int, default=1, help="Kills of a search at random moments. [default: 1]")


@pytest.fixture
def brief() -> Iterator[None]:
    """Results as small as those of `brief_results`."""
    from brief_results import brief

    with brief():
        yield


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
