"""Populations that a CUDA device and the processor score alike; as a script: their scores in numba's CUDA simulator."""

import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import CartesianProblem, Inputs
from gpmodel.evolution.scoring import Scores
from gpmodel.evolution.settings import Budget, Device, Settings
from gpmodel.formula.operators import ARITHMETIC

THESIS = {"length": 60, "registers": 5, "own_constants": 0, "start_inputs": False, "direct": False}
EVERY = {"length": 48, "registers": 4, "operators": tuple(operator.name for operator in ARITHMETIC)}
KINDS = ("length", "length", "length", "angle", "short angle", "time")


@dataclass(frozen=True)
class Case:
    """Sequences as ``linear`` has them on so many poses; typed by ``KINDS`` or not."""

    linear: Linear
    poses: int
    norm: str = "max"
    typed: bool = False

    def scores(self, device: Device, population: int) -> Scores:
        """Scores of a random population, the same at every call."""
        rng = np.random.default_rng(self.poses)
        values = rng.normal(size=(6, self.poses))
        inputs = Inputs(("x", "y", "z", "a", "b", "t"), values, KINDS if self.typed else ())
        problem = CartesianProblem(inputs, values[:3] + 0.1 * rng.normal(size=(3, self.poses)), self.norm)
        run = Generations(problem, Settings(self.linear, budget=Budget(population, 1, threads=1, device=device)), rng)
        return run.start()[1]


CASES = {
    "thesis": Case(Linear(operators="thesis", **THESIS), 7),
    "thesis, typed, rms": Case(Linear(operators="thesis", **THESIS), 7, "rms", typed=True),
    "own constants": Case(Linear(**EVERY, own_constants=5), 4, "rms"),
    "own constants, typed": Case(Linear(**EVERY, own_constants=5), 11, typed=True),
    "one pose": Case(Linear(**EVERY), 1),
}


def simulated(path: Path) -> None:
    """Scores of every case to a file, by the simulator: four threads a block, seven programs at a time."""
    from gpmodel.evolution.kernels import cuda, execute

    plain = SimpleNamespace(sin=np.sin, cos=np.cos, tan=np.tan, asin=np.arcsin, sqrt=np.sqrt)
    vars(execute)["math"] = plain  # Python's own raise errors where compiled ones give numbers that are not finite
    vars(cuda)["MOST_THREADS"] = 4
    found = {}
    for name, case in CASES.items():
        longest = case.linear.length + case.linear.own_constants + 1
        vars(cuda)["ROOM"] = 8 * longest * 7
        with np.errstate(all="ignore"):
            scores = case.scores("cuda", 20)
        found |= {f"{name} {part}": getattr(scores, part) for part in ("score", "complexity", "hashes")}
    np.savez(path, **found)


if __name__ == "__main__":
    simulated(Path(sys.argv[1]))
