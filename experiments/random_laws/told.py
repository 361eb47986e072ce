"""Compare founders with the formulas that are bred from them, at a known site and with known inputs.

From the root of the repository:
python -m experiments.random_laws.told --factors one,two,weighted,product,sum,waves --seeds 40,41 --results FILE.jsonl
For the robots of random_laws, the formula of least description length and the true formula are fitted with the geometry
and compared by their errors at new exact positions. Seconds are processor time of the search. A repeated command
continues.
"""

from __future__ import annotations

import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments.blind.grading import nodes
from experiments.blind.oracle import rms_mm
from experiments.methods.plug import Files, leaderboard, predicted
from experiments.methods.rows import Row, append, explained, rounded, saved
from experiments.options import parsed
from experiments.random_laws.judge import drawn, oracle, write
from experiments.random_laws.law import Place
from experiments.random_laws.robot import Robot, factors_of, is_aside, make
from experiments.random_laws.run import group, shown
from gpmodel.discovery.targets import readable_inputs, targets
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evolution.formulas import formulas_at
from gpmodel.evolution.memetic import GENERATIONS
from gpmodel.evolution.problems import SlotProblem
from gpmodel.formula.expression import Expression
from gpmodel.formula.program import description_size
from gpmodel.model.sites import Site
from gpmodel.selection.programs import expression_text

BREEDING = {"founders": 0, "bred": GENERATIONS}
"""Generations of each method."""


def searched(robot: Robot, files: Files, place: Place, generations: int) -> tuple[Expression | None, float]:
    """The formula of least description length at the law's site in the law's inputs, None without, and seconds of its
    search. Large errors are as they are measured."""
    ladder = gp.calibrate(files[1], files[0], holdout=0.0).calibrated
    residual = residual_of(ladder.final, ladder.poses, Criteria(), 0, np.ones(len(ladder.poses), bool))
    rows = np.arange(len(residual.poses))
    inputs, written = readable_inputs(residual.poses.states, rows)
    there = targets(residual, (Site(((place.slot, place.axis, 1.0),)),), rows)
    problem = SlotProblem(inputs, there, parsimony=gp.Search().nats_per_node)
    assert robot.law
    read = [name for name in robot.law.inputs if name in inputs.names]
    started = time.process_time()
    found = formulas_at(problem, 0, read, generations)
    seconds = time.process_time() - started
    if not found:
        return None, seconds
    best = max(found, key=lambda one: float(problem.nats(one.gain, description_size(one.program) + 1)))
    return Expression(expression_text(best.program, written)), seconds


def judged(seed: int, factors: int | str, index: int, method: str, folder: Path) -> Row:
    """One robot by one method."""
    robot = make(seed, factors, index)
    files, place = write(robot, folder), robot.place
    assert place
    formula, seconds = searched(robot, files, place, BREEDING[method])
    effects = [gp.effect_at("found", place.slot, place.axis, formula, family="found")] if formula else []
    models = (gp.calibrate(files[1], files[0], some, holdout=0.0).model for some in ([], effects))
    positions = *(predicted(model, files[2]) for model in models), oracle(robot, files)[0]
    errors = [rms_mm(found - robot.fresh.clean) for found in positions]
    found = []
    if formula:
        size = {"inputs": len(formula.inputs), "nodes": nodes(str(formula))}
        found = [{"law": str(formula), **size, "named": False, "found_by": "evolved"}]
    return {
        "method": method, "seed": seed, "factors": factors, "index": index, **drawn(robot), "geometry_mm": errors[0],
        "error_mm": errors[1], "oracle_mm": errors[2], "ratio": errors[1] / errors[2], "explained": explained(*errors),
        "seconds": round(seconds, 2), "found": found, "false": 0,
    }  # fmt: skip


def main() -> None:
    settings = parsed(
        __doc__, factors="weighted,product,sum", seeds="40,41", robots=4, methods=",".join(BREEDING),
        minutes=float("inf"), results=Path,
    )  # fmt: skip
    rows, until = saved(settings.results), time.monotonic() + 60 * settings.minutes
    seeds = [int(word) for word in settings.seeds.split(",")]
    for index, seed, factor in product(range(settings.robots), seeds, factors_of(settings.factors)):
        for method in settings.methods.split(","):
            if (identity := (method, seed, factor, index)) in rows or time.monotonic() > until:
                continue
            with tempfile.TemporaryDirectory() as folder:
                row = shown(judged(seed, factor, index, method, Path(folder)), False)
            rows[identity] = row
            append(row, settings.results)
            if not is_aside(seed):
                print(rounded(row), flush=True)
    text = leaderboard(rows.values(), group)
    settings.results.with_suffix(".md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
