"""Measure whether the formula of an effect is found at a known site with known inputs.

    python -m experiments.recovery.at_place --factors 1,2 --laws 80 --out FILE.json

60 to 350 poses; what each says of the law is weighted and seen beside fifteen other unknowns, as in a calibration. The
error at 500 fresh poses is over that of least squares told the law.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from experiments.options import parsed
from experiments.random_laws.law import Law, one_variable, two_variables
from gpmodel.evolution.formulas import formulas_at
from gpmodel.evolution.pareto import description_length
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import Targets

FRESH, OTHERS = 500, 14
NAMES = ("first", "second")
Array = np.ndarray


@dataclass(frozen=True)
class Place:
    """A law drawn at a place. columns (K, N): the other unknowns; sensitivity, exact and measured (N,)."""

    text: str
    poses: int
    inputs: dict[str, Array]
    truth: Array
    columns: Array
    sensitivity: Array
    exact: Array
    measured: Array

    def problem(self) -> SlotProblem:
        """The search for its law on the poses before the fresh ones."""
        known = slice(0, self.poses)
        basis, w = np.linalg.qr(self.columns[:, known].T)[0], self.sensitivity[known]
        left = self.measured[known] - basis @ (basis.T @ self.measured[known])
        targets = Targets((w**2)[None], (basis * w[:, None]).T[None], (w * left)[None], float(left @ left), ("here",))
        columns = np.array([column[known] for column in self.inputs.values()])
        return SlotProblem(Inputs(tuple(self.inputs), columns), targets, parsimony=2.0)

    def error(self, law: Array) -> float:
        """RMS error at the fresh poses of a fit with a law (N,) and the other unknowns."""
        design = np.vstack([self.sensitivity * law, self.columns]).T
        if not np.isfinite(design).all():
            return np.inf
        solution = np.linalg.lstsq(design[: self.poses], self.measured[: self.poses], rcond=None)[0]
        return float(np.sqrt(np.mean((design @ solution - self.exact)[self.poses :] ** 2)))


def drawn(factors: int, number: int) -> Place:
    """The place of a number, always the same."""
    rng = np.random.default_rng([17, factors, number])
    text = (one_variable if factors == 1 else two_variables)(rng)[1]
    poses = int(np.exp(rng.uniform(np.log(60), np.log(350))))
    total, noise = poses + FRESH, rng.uniform(0.05, 0.3)
    spread = (rng.uniform(-1, 1, total), np.clip(rng.normal(0, 0.45, total), -1, 1))
    scaled = [rng.permutation(spread[rng.integers(2)]) for _ in range(factors)]
    inputs = {name: 1.7 * u + 0.2 for name, u in zip(NAMES, scaled, strict=False)}
    shape = Law(text, NAMES[:factors], (0.2,) * factors, (1.7,) * factors)(inputs)
    shape = shape / shape.std()
    sensitivity = np.exp(rng.normal(0, 0.4, total))
    turned = rng.normal(0, 1, (OTHERS, factors + 3)) @ np.vstack([*scaled, rng.uniform(-1, 1, (3, total))])
    columns = np.vstack([sensitivity, np.sin(turned + rng.uniform(0, 6, (OTHERS, 1)))])
    exact = sensitivity * shape + rng.normal(0, 1, OTHERS + 1) @ columns
    return Place(text, poses, inputs, shape, columns, sensitivity, exact, exact + noise * rng.normal(0, 1, total))


def judged(factors: int, number: int) -> dict[str, Any]:
    """Return the formula found at a site, and its error relative to that of the true formula."""
    place = drawn(factors, number)
    problem, began = place.problem(), time.process_time()
    best = min(formulas_at(problem, 0, tuple(place.inputs)), key=lambda law: description_length(law, problem))
    seconds = time.process_time() - began
    with np.errstate(all="ignore"):
        ratio = place.error(best.program.evaluate(place.inputs)[0]) / place.error(place.truth)
    return {
        "law": place.text, "poses": place.poses, "found": str(best.program), "nodes": best.complexity,
        "ratio": round(ratio, 3), "seconds": round(seconds, 1),
    }  # fmt: skip


def main() -> None:
    settings = parsed(__doc__, factors="1,2", laws=80, out=None)
    out: dict[str, Any] = {}
    for factors in settings.factors.split(","):
        with threadpool_limits(1):
            rows = [judged(int(factors), number) for number in range(settings.laws)]
        ratios = np.array([row["ratio"] for row in rows])
        out[factors] = {
            "laws": len(rows), "within 1.25": int((ratios < 1.25).sum()), "within 1.5": int((ratios < 1.5).sum()),
            "median ratio": round(float(np.median(ratios)), 3),
            "at most 9 nodes": sum(row["nodes"] <= 9 for row in rows),
            "median seconds": round(float(np.median([row["seconds"] for row in rows])), 1), "each": rows,
        }  # fmt: skip
        print(factors, {key: value for key, value in out[factors].items() if key != "each"})
    if settings.out:
        settings.out.write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
