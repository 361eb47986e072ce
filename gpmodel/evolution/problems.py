"""Problems of genetic programming: a compensator in Cartesian space, or the basis function (and site) of an effect."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.evolution.code import Code, Scores
from gpmodel.evolution.description_length import fit_nats, ranked
from gpmodel.evolution.engine import BLOCK, compensator_fitness, values
from gpmodel.evolution.projection import Targets
from gpmodel.evolution.scoring import projected_scores

COORDINATES = ("x", "y", "z")


@dataclass(frozen=True)
class Inputs:
    """Named columns that a program may use: values (inputs, poses), scaled to order one by the caller.

    kinds: kind of quantity of each column (``gpmodel.evolution.kinds``), so that only meaningful programs are searched.
    Inputs without kinds allow any program. Raises InputError if a name repeats, shapes disagree or a number is not
    finite.
    """

    names: tuple[str, ...]
    values: Array
    kinds: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values, dtype=float)
        object.__setattr__(self, "values", values)
        if values.ndim != 2 or len(values) != len(self.names) or not len(values):
            raise InputError(
                f"inputs: values of shape {values.shape}, expected ({len(self.names)}, poses), one row per name"
            )
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            raise InputError(f"inputs: {repeated[0]!r} appears twice")
        if self.kinds and len(self.kinds) != len(self.names):
            raise InputError(f"inputs: {len(self.kinds)} kinds for {len(self.names)} names, expected one kind per name")
        for name, column in zip(self.names, values, strict=True):
            if not np.all(np.isfinite(column)):
                rows = np.flatnonzero(~np.isfinite(column))
                raise InputError(f"inputs: column {name!r} is not finite in row {rows[0]}, expected numbers")

    def __getitem__(self, name: str) -> Array:
        return np.asarray(self.values[self.names.index(name)])

    def mapping(self) -> dict[str, Array]:
        """Return {name: column}, as ``Program.evaluate`` expects the inputs."""
        return dict(zip(self.names, self.values, strict=True))

    def select(self, names: Sequence[str]) -> "Inputs":
        """Return the inputs with the given names. Raises InputError for an unknown name."""
        unknown = [name for name in names if name not in self.names]
        if unknown:
            raise InputError(f"inputs: unknown {unknown[0]!r}, available: {choices(unknown[0], self.names)}")
        rows = [self.names.index(name) for name in names]
        return Inputs(tuple(names), self.values[rows], tuple(self.kinds[row] for row in rows) if self.kinds else ())


@dataclass(frozen=True)
class CartesianProblem:
    """Search for a compensator as in thesis Fig 5.2: its outputs r0, r1, r2 approximate measured points (3, poses).

    norm: "max" (Robertson 2003, Fig 5.5) or "rms" of the distances over the poses.
    inputs: the inputs x, y, z are the points of the model in the unit of ``measured``; the registers start with them.
    parsimony: penalty of a node in the unit of ``measured``.
    The gain of a program is the share of the norm that the program removes. Raises InputError if x, y or z is missing
    or measured points are not finite.
    """

    inputs: Inputs
    measured: Array
    norm: str = "max"
    parsimony: float = 0.0
    slice: ClassVar[int] = 2048
    start: ClassVar[tuple[str, ...]] = COORDINATES

    def __post_init__(self) -> None:
        if self.norm not in ("max", "rms"):
            raise InputError(f"norm: {self.norm!r}, expected 'max' or 'rms'")
        missing = [name for name in COORDINATES if name not in self.inputs.names]
        if missing:
            raise InputError(f"inputs: {missing[0]!r} is missing, expected x, y and z, the inputs of a compensator")
        if self.measured.shape != (3, self.inputs.values.shape[1]) or not np.all(np.isfinite(self.measured)):
            raise InputError("measured: expected finite points, one column (x, y, z) a pose")

    @property
    def can_stop_early(self) -> bool:
        """True if scoring a program may stop at a limit of the error."""
        return self.norm == "max" and not self.parsimony and self.measured.shape[1] > BLOCK

    @cached_property
    def initial_norm(self) -> float:
        """Norm of the distances of the model's points from the measured points, without compensation."""
        return self.norm_of(self.inputs.select(COORDINATES).values)

    def norm_of(self, points: Array) -> float:
        """Return the norm (largest or RMS) of the distances of points (3, poses) from the measured points, in the unit
        of ``measured``; not finite if a point is not."""
        with np.errstate(all="ignore"):
            squares = np.square(points - self.measured).sum(axis=0)
        return float(np.sqrt(squares.max() if self.norm == "max" else squares.mean()))

    def shuffled(self, rng: np.random.Generator) -> "CartesianProblem":
        """Return the problem with the errors (measured minus model) permuted over the poses."""
        model = self.inputs.select(COORDINATES).values
        error = (self.measured - model)[:, rng.permutation(self.measured.shape[1])]
        return replace(self, measured=model + error)

    def scores(self, code: Code, fixed: Array, cutoff: float = np.inf) -> Scores:
        """Return the scores of decoded programs: norm of the residual + parsimony * nodes. The gain of a program is 1 -
        norm / initial norm. fixed: values (rows, poses) of inputs and constants. Scores above ``cutoff`` may be inf."""
        from gpmodel.evolution.kernels.batch import sizes_by_outputs

        fitness = compensator_fitness(code, fixed, self.measured, self.norm == "max", cutoff)
        whole = np.zeros(len(fitness), np.int64)
        with np.errstate(invalid="ignore"):
            gain = 1.0 - fitness / self.initial_norm
        nodes = sizes_by_outputs(code, len(fixed)).sum(axis=1, dtype=np.int64)
        return Scores(fitness + self.parsimony * nodes, gain, nodes, whole, whole + 7, code.hashes)


def never() -> bool:
    """Return False, as the time of a search without a limit is never over."""
    return False


@dataclass(frozen=True)
class SlotProblem:
    """Search for the basis function of an effect and its site; coefficients are solved by projection. parsimony:
    penalty of a node or a coefficient, nats. is_over: function that returns whether the time of the search is over."""

    inputs: Inputs
    targets: Targets
    parsimony: float = 1.0
    is_over: Callable[[], bool] = never
    slice: ClassVar[int] = 512
    start: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        if self.targets.poses != self.inputs.values.shape[1]:
            raise InputError(
                f"targets: {self.targets.poses} poses, expected {self.inputs.values.shape[1]} as in the inputs"
            )

    def only(self, site: int, names: Sequence[str]) -> "SlotProblem":
        """Restrict the search problem to one site and to the inputs of given names."""
        return replace(self, inputs=self.inputs.select(names), targets=self.targets.only(site))

    def scores(self, code: Code, fixed: Array, cutoff: float = np.inf) -> Scores:
        """Return the description length and gain of decoded programs at their best site."""
        return projected_scores(values(code, fixed), code, len(fixed), self.targets, self.parsimony)

    def nats(self, gain: Array | float, size: Array | float) -> Array:
        """Return the decrease of the description length, nats: -components/2 · ln(1 - gain) minus the penalty of the
        size."""
        return ranked(fit_nats(gain, self.targets.components) - self.parsimony * np.asarray(size))

    def shuffled(self, rng: np.random.Generator) -> "SlotProblem":
        """Return the problem with the residual permuted over the poses."""
        return replace(self, targets=self.targets.shuffled(rng))


Problem = CartesianProblem | SlotProblem
