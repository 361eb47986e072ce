"""Every choice of the evolutionary search, with the thesis' own as one named setting."""

from dataclasses import dataclass, replace
from typing import Any

from gpmodel.errors import InputError
from gpmodel.formula.operators import TABLE_CONSTANTS, operator_set

REPRESENTATIONS = ("linear", "tree")


@dataclass(frozen=True)
class Settings:
    """Choices of one run; the defaults search a slot's shape.

    representation: "linear" (a sequence of ``length`` genes) or "tree" (no deeper than ``depth``).
    population, generations, seconds: whichever of the last two ends first.
    operators: a named set (``gpmodel.formula.operators.SETS``) or names; constants: fixed ones, own_constants: how
    many more each program carries (bred, and polished every ``polish_every`` generations where not 0).
    registers: of the linear machine; outputs: how many of them (or trees) are offered as a basis.
    start_inputs: registers start from the inputs in turn rather than from 0; direct: binary operators may
    name an element as well as a register.
    selection: "truncation" (thesis: parents drawn from the best ``selected`` share, the population replaced)
    or "tournament" (of ``tournament``; the best of parents and children live on, one of each score first with
    ``keep_distinct``).
    crossover, mutation: per element for sequences; crossover is per child for trees.
    parsimony: cost of a node, in nats for a slot and in the unit of the norm for a compensator.
    target: stop once a program reaches this gain.
    climb: the best programs of a slot search, so many, are finished by single edits (0: none).
    restart_after: generations without progress before a fresh population (0: never).
    breeding: "koza" or "thesis" for trees. threads: 0 for all cores; never changes a result.
    Raises InputError for a choice out of range.
    """

    representation: str = "linear"
    population: int = 1024
    generations: int = 1_000_000
    seconds: float = 5.0
    operators: str | tuple[str, ...] = "slot"
    constants: tuple[float, ...] = (1.0, 2.0)
    own_constants: int = 4
    length: int = 40
    registers: int = 4
    outputs: int = 3
    start_inputs: bool = True
    direct: bool = True
    depth: int = 6
    breeding: str = "koza"
    selection: str = "tournament"
    selected: float = 0.05
    tournament: int = 4
    keep_distinct: bool = True
    crossover: float = 0.03
    mutation: float = 0.05
    parsimony: float = 1.0
    polish_every: int = 10
    restart_after: int = 60
    target: float = 1.0
    climb: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        limits: dict[str, tuple[float, float]] = {
            "population": (4, 2**24),
            "generations": (0, 10**9),
            "seconds": (0.0, 1e9),
            "own_constants": (0, 64),
            "length": (2, 4096),
            "registers": (1, 31),
            "outputs": (1, 8),
            "depth": (1, 40),
            "selected": (1e-6, 1.0),
            "tournament": (1, 1000),
            "crossover": (0.0, 0.999),
            "mutation": (0.0, 0.999),
            "parsimony": (0.0, 1e6),
        }
        for name, (least, most) in limits.items():
            if not least <= getattr(self, name) <= most:
                raise InputError(f"{name}: {getattr(self, name)}, expected {least:g} to {most:g}")
        options = {
            "representation": REPRESENTATIONS,
            "breeding": ("koza", "thesis"),
            "selection": ("truncation", "tournament"),
        }
        for name, allowed in options.items():
            if getattr(self, name) not in allowed:
                raise InputError(f"{name}: {getattr(self, name)!r}, expected {' or '.join(allowed)}")
        if self.representation == "linear" and self.outputs > self.registers:
            raise InputError(f"outputs: {self.outputs}, but there are {self.registers} registers")
        if self.selection == "truncation" and self.population * self.selected < 2:
            raise InputError(
                f"population: {self.population} is too small to select {self.selected:.1%} from, "
                f"expected at least {2 / self.selected:.0f}"
            )
        operator_set(self.operators)

    @staticmethod
    def thesis(representation: str = "linear", **changes: Any) -> "Settings":
        """Section 5.2.2: 64K sequences of 160 elements, Table 5.1, 1 % crossover and mutation, 5 % selected."""
        return replace(
            Settings(
                representation=representation,
                population=65536 if representation == "linear" else 4096,
                generations=100,
                seconds=1e9,
                operators="thesis",
                constants=TABLE_CONSTANTS,
                own_constants=0,
                length=160,
                registers=8,
                outputs=3,
                start_inputs=False,
                direct=False,
                depth=12,
                breeding="thesis",
                selection="truncation",
                selected=0.05,
                crossover=0.01 if representation == "linear" else 0.8,
                mutation=0.01,
                parsimony=0.0,
                polish_every=0,
                restart_after=0,
            ),
            **changes,
        )
