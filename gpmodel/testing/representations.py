"""Contract of a representation of programs."""

import numpy as np

from gpmodel.evolution import engine
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings


def check_representation(representation: Representation, *, population: int = 64, seed: int = 0) -> None:
    """A representation of programs: what it starts, breeds and decodes, and that a search with it finds a plain law.

    Checked: populations of the size asked for; effective code that runs like the program it stands for, signs and
    order of operands included; take and join keep programs; the seed alone decides, whatever the threads; the law
    a - b is found, which b - a is not.
    """
    rng = np.random.default_rng(seed)
    inputs = Inputs(("a", "b"), rng.normal(size=(2, 40)))
    breeding = representation.breeding(inputs, (), 1)
    layout = breeding.layout
    first = breeding.initial(population, np.random.default_rng(seed))
    again = breeding.initial(population, np.random.default_rng(seed))
    assert len(first) == population, f"initial gives {len(first)} programs, {population} were asked for"
    rows = np.arange(population)
    children = breeding.offspring(first, rows, rows[::-1].copy(), np.random.default_rng(seed + 1))
    assert len(children) == population, f"offspring gives {len(children)} children of {population} pairs"
    for what, programs in (("initial", first), ("offspring", children)):
        code = programs.decoder(layout)(slice(0, population))
        found = engine.values(code, layout.fixed_rows(inputs.values)).copy()
        for row in range(population):
            program = programs.program(row, layout)
            expected = program.evaluate(inputs.mapping())
            nearby = program.evaluate({name: values * (1 + 1e-12) for name, values in inputs.mapping().items()})
            with np.errstate(invalid="ignore"):
                well = np.abs(nearby - expected) <= 1e-8 * (1.0 + np.abs(expected))
            same = np.allclose(found[row][well], expected[well], rtol=1e-6, atol=1e-7)
            assert same, f"{what}: the code of program {row}, {program}, gives other values than the program"
    text = [str(first.program(row, layout)) for row in range(population)]
    assert text == [str(again.program(row, layout)) for row in range(population)], "initial depends on more than a seed"
    moved = first.take(rows[::-1].copy()).join(first)
    there = [str(moved.program(row, layout)) for row in (0, population)]
    assert there == [text[-1], text[0]], "take and join do not keep programs as they are"
    _check_search(representation, inputs, seed)


def _check_search(representation: Representation, inputs: Inputs, seed: int) -> None:
    law = inputs["a"] - inputs["b"]
    problem = SlotProblem(inputs, regression(law))
    best = []
    for threads in (1, 2):
        settings = Settings(representation, budget=Budget(256, 20, seconds=1e9, threads=threads))
        best.append(evolve(problem, settings, np.random.default_rng(seed)).best)
    assert str(best[0].program) == str(best[1].program), "what is found depends on the number of threads"
    assert best[0].gain > 0.999, f"a - b is not found by 256 programs in 20 generations: {best[0].program}"
