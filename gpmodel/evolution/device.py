"""Populations scored on a CUDA device: large ones of linear sequences in Cartesian space.

At a slot the execution of programs is a hundredth of a run, and trees are laid out by the processor: neither gains.
"""

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.engine import norms
from gpmodel.evolution.linear import Sequences
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import CartesianProblem, Scored
from gpmodel.evolution.representation import Population
from gpmodel.evolution.scoring import Scores


def check_device() -> None:
    """Raises InputError where there is no CUDA device to be used here, saying what is missing."""
    try:
        from gpmodel.evolution.kernels.cuda import cuda

        there = cuda.is_available()
    except ImportError:
        there = False
    if not there and find_spec("numba_cuda") is None:
        raise InputError("'cuda' needs numba-cuda; pip install 'gpmodel[cuda]'", "device")
    if not there:
        raise InputError("'cuda', but no CUDA device answers here, expected one with its driver, or 'cpu'", "device")


@dataclass(frozen=True)
class OnDevice:
    """Scores of sequences of a layout by a CUDA device; fixed (base, N) are its rows of inputs and constants.

    They are those of the processor but for the rounding of the programs' values; equal code has the same hash.
    Raises InputError where a problem is no CartesianProblem, or no device can be used.
    """

    problem: Scored
    layout: Layout
    fixed: NDArray[np.float64]

    def __post_init__(self) -> None:
        if not isinstance(self.problem, CartesianProblem):
            raise InputError("'cuda' scores compensators in Cartesian space only", "device")
        check_device()

    def __call__(self, population: Population) -> Scores:
        """Scores of a whole population."""
        from gpmodel.evolution.kernels.cuda import compensator_fitness

        problem = self.problem
        assert isinstance(problem, CartesianProblem)
        if not isinstance(population, Sequences):
            raise InputError("'cuda' runs linear sequences only", "device")
        maximum = problem.norm == "max"
        squares, nodes, hashes = compensator_fitness(
            population.genes, population.constants, self.layout, self.fixed, problem.measured, maximum
        )
        return problem.scores_of(norms(squares, self.fixed.shape[1], maximum), nodes, hashes)
