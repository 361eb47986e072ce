"""Run the six steps of thesis section 5.2.4 in one file, with an exchange after each round.

From the root of the repository: python -m experiments.framework.run [--rounds 4] [--runs 8] [--population 512]
[--generations 30] [--out FOLDER]
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.chapter5 import KINDS, THESIS_INPUTS, effects_of, options, rounded, save
from experiments.irb6400r_truth import Case, measured_robot
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.targets import targets
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import sites_of

SHORT_LIST = 40
"""Known effects whose pairs are tried: 780 pairs, a tenth of a second."""

Found = tuple[Candidate, ...]
Histogram = tuple[Solution, list[int], list[int]]


def fitted(case: Case, found: Found) -> Calibration:
    """The standard model with what was found, fitted to the training poses."""
    effects = (*effects_of(case), *(e for candidate in found for e in candidate.effects))
    return calibrate(ErrorModel(case.mechanism, effects), case.poses.subset(case.train))


def joined(pair: Found) -> Candidate:
    """Candidates as one."""
    effects = tuple(e for candidate in pair for e in candidate.effects)
    return Candidate(" and ".join(c.name for c in pair), effects, "", sum(c.cost for c in pair))


def looked_back(case: Case, found: Found, known: Sequence[Candidate]) -> tuple[Found, str]:
    """The newest model and one of the earlier exchanged for two others, where these say it better; the exchange.

    One model may stand for a part of several, and hides each of them until two come in its place. Better: the shortest
    description of all pairs of the SHORT_LIST best, shorter by `Criteria.tie`.
    """
    criteria, newest = Criteria(), found[-1]
    best, said = (criteria.tie, found), ""
    for old in found[:-1]:
        others = tuple(candidate for candidate in found if candidate not in (old, newest))
        residual = residual_of(fitted(case, others), case.poses.subset(case.train), criteria, 0)
        order = np.argsort([-score.nats for score in scores(residual, known)], kind="stable")
        pairs = [(old, newest), *combinations([known[i] for i in order[:SHORT_LIST]], 2)]
        nats = np.array([score.nats for score in scores(residual, [joined(pair) for pair in pairs])])
        k = int(np.argmax(nats))
        if nats[k] - nats[0] > best[0]:
            best = nats[k] - nats[0], (*others, *pairs[k])
            said = f"{joined(pairs[k]).name} instead of {joined(pairs[0]).name}"
    return best[1], said


def evolved(case: Case, model: Calibration, settings: Settings, runs: int, rng: np.random.Generator) -> Histogram:
    """The best of the runs, and how many reference each input, on measured and on shuffled errors."""
    train = case.poses.subset(case.train)
    inputs = Inputs(THESIS_INPUTS, np.array([train.states[n] for n in THESIS_INPUTS]), KINDS)
    residual = residual_of(model, train, Criteria(), 0)
    problem = SlotProblem(inputs, targets(residual, sites_of(case.mechanism), np.arange(len(train))), parsimony=2.0)
    real = [evolve(problem, settings, rng).best for _ in range(runs)]
    null = [evolve(problem.shuffled(rng), settings, rng).best for _ in range(runs)]
    used, by_chance = ([sum(n in b.program.inputs for b in best) for n in THESIS_INPUTS] for best in (real, null))
    return max(real, key=lambda b: b.gain), used, by_chance


def draw(panels: tuple[Axes, Axes], record: dict[str, Any], errors: tuple[Array, Array], runs: int) -> None:
    """The histogram of a round above the held-out errors before and after it, m."""
    top, bottom = panels
    used, by_chance = zip(*record["inputs"].values(), strict=True)
    top.bar(np.arange(9) - 0.2, used, 0.4, label="measured errors")
    top.bar(np.arange(9) + 0.2, by_chance, 0.4, color="0.7", label="shuffled errors")
    top.set_xticks(range(9), THESIS_INPUTS, fontsize=8)
    titles = [f"round {record['round']}", *record["model"]]
    top.set_title("\n".join(titles), fontsize=8)
    top.set_ylim(0, 1.4 * runs)
    bottom.hist([1e3 * e for e in errors], bins=12, color=["0.7", "tab:green"], label=["before", "after"])
    bottom.set_xlabel("held-out error, mm", fontsize=8)
    for panel in panels:
        panel.legend(fontsize=7, frameon=False)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "framework", arguments, rounds=4, runs=8, population=512, generations=30)
    case, rng = measured_robot(0), np.random.default_rng(524)
    train, heldout = case.poses.subset(case.train), case.poses.subset(case.heldout)
    known = [c for c in catalogue.candidates(case.mechanism, train.states) if not c.has_priors]

    # 1. Operators: smooth ones, of the same order as what they are given.
    operators = ("add", "subtract", "multiply", "square", "sin", "cos")
    # 2. Representation: few operations on many inputs suit trees, many on few suit a sequence.
    representation = Linear(operators=operators, crossover=0.03, mutation=0.05)
    # 3. Evolutionary parameters.
    settings = Settings(representation, budget=Budget(chosen.population, chosen.generations, seconds=1e9))

    found: Found = ()
    rounds: list[dict[str, Any]] = []
    figure = Figure(figsize=(3.4 * chosen.rounds, 5), layout="constrained")
    for number, panels in enumerate(figure.subplots(2, chosen.rounds, squeeze=False).T, 1):
        model = fitted(case, found)
        before = errors_on(model, heldout)

        # 4. Which inputs do programs use, more often than on shuffled errors?
        best, used, by_chance = evolved(case, model, settings, chosen.runs, rng)

        # 5. How do the evolved equations behave, and which known effect behaves like them?
        saved = scores(residual_of(model, train, Criteria(), 0), known)
        order = sorted(range(len(known)), key=lambda i: -saved[i].nats)[:3]

        # 6. Put the physical model into the simulation, look back, and see what it is worth on poses it has not seen.
        put_in = known[order[0]]
        found, exchanged = looked_back(case, (*found, put_in), known)
        after = errors_on(fitted(case, found), heldout)
        rounds.append(
            {
                "round": number,
                "inputs": dict(zip(THESIS_INPUTS, zip(used, by_chance, strict=True), strict=True)),
                "equation": f"{best.program} at {best.site_name}",
                "hypotheses": {known[i].name: round(saved[i].nats, 1) for i in order},
                "put in": put_in.name,
                "exchanged": exchanged,
                "model": [candidate.name for candidate in found],
                "held-out mean, max before": rounded([before.mean(), before.max()]),
                "held-out mean, max after": rounded([after.mean(), after.max()]),
            }
        )
        print(rounds[-1], flush=True)
        draw(tuple(panels), rounds[-1], (before, after), chosen.runs)
    results = {"robot": 0, "rounds": rounds}
    save(chosen, results, {"framework": figure})
    return results


if __name__ == "__main__":
    main()
