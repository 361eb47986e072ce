"""Settings of the search: its runs, their operators, and when to stop."""

import math
from dataclasses import dataclass, field

from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.settings import Budget, SelectionScheme, Tournament
from gpmodel.executor import Workers
from gpmodel.forks import Forks


@dataclass(frozen=True)
class Search:
    """Effort of a discovery.

    runs: GP runs a strategy and round, and at most as many on shuffled residuals, three at least in a first round.
    strategies: what the runs evolve; trees take twice the time of sequences and found nothing more on the shipped table
    and ten planted shapes.
    selection: who breeds and who lives on.
    population, generations: of one run. opening_population, opening_generations: at most so many in the first round
    where named effects are offered: its runs tell which inputs the residual depends on, and what is named is chosen
    without them; a fraction of a second each. climb: how many of a run's best programs are finished by single edits.
    nats_per_node: what a node of a program costs, the log of about seven inputs and operators to choose from.
    evolved_poses: poses that GP sees at most, sampled anew every round; scored_poses: poses that all is chosen on where
    there are more than half as many again, drawn evenly along the rows: on 500 shows what is a fifth of the noise, and
    the numbers of what is chosen are fitted to all. stop_after: seconds after which no new round begins, None for no
    limit. max_effects: findings after which no new round begins. workers: GP runs side by side, which change no number.
    executor: runs them elsewhere.
    considered: evolved programs that are offered to the selection at most, the best first.
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
    climb: int = 2
    nats_per_node: float = 2.0
    evolved_poses: int = 300
    scored_poses: int = 500
    considered: int = 48
    executor: Workers | None = None

    @property
    def side_by_side(self) -> Workers:
        """Workers for independent tasks."""
        return self.executor or self.here

    @property
    def here(self) -> Forks:
        """Workers on this machine, for tasks too large to be sent to another."""
        return self.executor if isinstance(self.executor, Forks) else Forks(self.workers)

    def cost(self, nodes: int, places: int) -> float:
        """Nats of a program: of its nodes, and of the place that it acts at among so many."""
        return self.nats_per_node * nodes + math.log(places)

    def budget(self, opening: bool) -> Budget:
        """Budget of one run; a small one in an opening round where named effects are offered."""
        population, generations = self.population, self.generations
        if opening:
            population = min(population, self.opening_population)
            generations = min(generations, self.opening_generations)
        return Budget(population, generations, seconds=1e9, climb=self.climb, threads=1)
