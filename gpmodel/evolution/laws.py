"""The shortest law of a curve: one term of one or two inputs at a known place, evolved in a fraction of a second."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from gpmodel.evolution.constants import polish
from gpmodel.evolution.description_length import gain_nats
from gpmodel.evolution.kinds import Typing
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.pareto import Solution, pareto, scored
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

MOST_INPUTS = 2
MOST_NODES = 7
"""Inputs that one law may read; nodes that it may be made of: the longest of the field's own, exp(-k (q - a)²), has as
many."""

TERM = Linear(length=24, registers=2, outputs=1, own_constants=3)
QUICK = Budget(population=256, generations=20, seconds=1e9, polish_every=5, restart_after=0, climb=3, threads=1)
"""A representation for one term; the small effort that finds one."""

FORMS = (
    "sin({n}*({q} - {a}))", "square({q} - {a})", "exp(-{k}*square({q} - {a}))", "tanh({k}*({q} - {a}))",
    "max({q} - {a}, 0)", "abs({q} - {a})", "exp(-{k}*{q})", "{q} - max(min({q}, {w}), -{w})",
)  # fmt: skip
"""Harmonic, parabola, bump, step, ramp, kink, decay, dead band: each has a place, which evolution finds late."""

PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of the input at which the forms start."""

POLISHED = 4
"""Programs, the best, whose constants are fitted."""


def shortest_laws(
    problem: SlotProblem, site: int, names: Sequence[str], rng: np.random.Generator, most_nodes: int = MOST_NODES
) -> tuple[Solution, ...]:
    """Laws of one term at one site in one or two inputs that no shorter one equals in gain, shortest first.

    ``problem.nats(law.gain, law.complexity + 1)`` says what each saves; the term's coefficient is solved. Empty where
    nothing explains anything. Depends on the arguments only, on one thread. Raises InputError for an unknown input.
    """
    there = problem.only(site, names)
    evolved = [law.program for law in evolve(there, Settings(TERM, budget=QUICK), rng).front]
    short = [program for program in evolved if program.complexity <= most_nodes]
    columns = there.inputs.mapping()
    fitted = [polish(program, there.targets, 0, columns)[0] for program in [*short, *_forms(there)]]
    return tuple(
        law for law in pareto([scored(program, there) for program in [*short, *fitted]])
        if 0 < law.complexity <= most_nodes and 1 <= len(law.program.inputs) <= MOST_INPUTS
    )  # fmt: skip


def _forms(problem: SlotProblem) -> list[Program]:
    """The few forms that explain most from where they start."""
    columns = problem.inputs.mapping()
    programs = list(_started(problem.inputs))
    gains = np.array([problem.targets.set_gain(program.evaluate(columns), 0)[0] for program in programs])
    return [programs[k] for k in np.argsort(-gain_nats(gains), kind="stable")[:POLISHED].tolist()]


def _started(inputs: Inputs) -> Iterator[Program]:
    """Every form of every input, and of sums and differences of two, that their kinds allow, at every place."""
    typing = Typing(inputs.kinds)
    columns = {repr(name): values for name, values in inputs.mapping().items()}
    for (first, one), (second, other) in combinations(tuple(columns.items()), 2):
        columns |= {f"({first} + {second})": one + other, f"({first} - {second})": one - other}
    for text, values in columns.items():
        scale = float(np.ptp(values)) or 1.0
        for form in FORMS:
            for place in np.quantile(values, PLACES).tolist():
                for turns in (1, 2, 3) if "{n}" in form else (1,):
                    steep = 20.0 / scale**2 if "square" in form else 5.0 / scale
                    program = parse(form.format(q=text, a=f"({place})", k=steep, n=turns, w=scale / 5.0))
                    if typing.allows(program, inputs.names):
                        yield program
