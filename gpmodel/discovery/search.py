"""Settings of the search for effects: numbers of runs, sizes of the populations, and limits."""

import math
from dataclasses import dataclass, field

from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.settings import Budget, SelectionScheme, Tournament
from gpmodel.executor import Forks, Workers


@dataclass(frozen=True)
class Search:
    """Settings of the search that determine its computing effort.

    runs: evolution runs of each representation in a round; permuted residuals get at most as many runs, but at least
    three in the first round.
    strategies: representations of evolved programs. Trees take twice the time of sequences and found nothing more on
        the shipped table and ten planted shapes.
    selection: scheme that selects parents and survivors of evolution.
    stop_after: seconds after which no new round begins; None for no limit.
    max_effects: number of findings after which no new round begins.
    workers: number of parallel runs; the number of workers changes no result.
    population, generations: number of programs and of generations of one run.
    opening_population, opening_generations: upper limits of `population` and `generations` in the first round, which
    only finds inputs if the catalogue is searched.
    climb: number of best programs of a run whose formulas are improved at its end.
    nats_per_node: penalty of a node of a formula, nats: the log of about seven inputs and operators.
    evolved_poses: largest number of poses for evolution, sampled again in every round.
    scored_poses: number of poses on which effects are selected, drawn evenly along the rows, if there are half as many
        again. With 500 poses an effect of a fifth of the noise is detected. Coefficients are fitted to all poses.
    considered: largest number of evolved programs offered to the selection, the best first.
    executor: workers that replace the workers on this machine.
    """

    runs: int = 8
    strategies: tuple[Representation, ...] = (Linear(),)
    selection: SelectionScheme = field(default_factory=Tournament)
    stop_after: float | None = None
    max_effects: int = 40
    workers: int = 2
    population: int = 1024
    generations: int = 40
    opening_population: int = 256
    opening_generations: int = 20
    climb: int = 1
    nats_per_node: float = 2.0
    evolved_poses: int = 300
    scored_poses: int = 500
    considered: int = 48
    executor: Workers | None = None

    @property
    def side_by_side(self) -> Workers:
        """Executor of the search's independent tasks: workers on this or other machines."""
        return self.executor or self.here

    @property
    def here(self) -> Forks:
        """Executor with workers on this machine, for tasks too large to be sent to another machine."""
        return self.executor if isinstance(self.executor, Forks) else Forks(self.workers)

    def cost(self, nodes: int, places: int) -> float:
        """Return the description length of a program, nats: penalty of its nodes plus log of the number of sites."""
        return self.nats_per_node * nodes + math.log(places)

    def budget(self, opening: bool) -> Budget:
        """Return numbers of programs and generations of one evolution run, small in an opening round."""
        population, generations = self.population, self.generations
        if opening:
            population = min(population, self.opening_population)
            generations = min(generations, self.opening_generations)
        return Budget(population, generations, seconds=1e9, climb=self.climb)
