"""Time of a fresh process before evolution starts."""

import os
import subprocess
import sys
import tempfile
import time

START = """
import numpy as np
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree
x = np.random.default_rng(0).normal(size=(3, 40))
problem = SlotProblem(Inputs(("a", "b", "c"), x), regression(x[0] * x[1]))
for kind in (Linear(), Tree()):
    evolve(problem, Settings(kind, budget=Budget(64, 2, polish_every=1)), np.random.default_rng(0))
"""


def cold_start() -> dict[str, float]:
    """Seconds of a fresh process that runs both representations once, and of the command's help."""
    found = {}
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        for name in ("compile cache empty", "compile cache warm"):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-c", START], check=True, env=environment)
            found[name] = round(time.perf_counter() - begin, 2)
    begin = time.perf_counter()
    shown = [sys.executable, "-c", "from gpmodel.cli.main import main; main()", "evolve", "--help"]
    subprocess.run(shown, check=True, stdout=subprocess.DEVNULL)
    found["gpmodel evolve --help"] = round(time.perf_counter() - begin, 2)
    return found
