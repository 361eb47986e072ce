"""Memory that was freed goes back to the system."""

import sys
from pathlib import Path

import numpy as np
import pytest

from gpmodel.numerics.allocation import give_back


def _pages() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.skipif(sys.platform != "linux", reason="pages in memory are counted in /proc")
def test_what_many_small_arrays_had_is_given_back() -> None:
    give_back()
    before = _pages()
    several = [np.ones(8_000) for _ in range(2_000)]
    held, last = _pages(), several[-1]
    del several
    give_back()
    assert held - before > 20_000
    assert _pages() - before < 0.2 * (held - before)
    assert last.sum() == 8_000
