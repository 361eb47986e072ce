"""Operon (Burlacu, Kronberger, Kommenda 2020) at the settings that its authors publish, and which of them suit best.

From the root of the repository: python -m experiments.recovery.operon [--seconds 5] [--every 2] [--out FOLDER]
Compares them on every second law of the half to tune on, one seed; the best is ``OPERON["Operon"]``, which the other
comparisons run. Sources: SRBench's methods/tuned/params/_operonregressor.py (2022) and algorithms/operon/regressor.py
(2025), both by Operon's authors; pyoperon's example/operon-sklearn.py.
"""

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.recovery.feynman import halves
from experiments.recovery.found import Found, slowdown
from experiments.tables import write_table

Array = NDArray[np.float64]

ALL_NEEDED = "add,sub,mul,div,square,sqrt,sin,cos,tanh,asin,exp,log,constant,variable"
"""Every operator of the laws, and no more."""

LARGEST_SET = "add,sub,mul,div,sin,cos,exp,log,sqrt,pow,constant,variable"
"""The largest of the sets that its authors choose from (SRBench 2025)."""


@dataclass(frozen=True)
class Operon:
    """pyoperon, Levenberg-Marquardt steps on every child, one thread; ``criterion`` picks the model of its front."""

    symbols: str = ALL_NEEDED
    iterations: int = 10
    population: int = 1000
    length: int = 50
    objectives: tuple[str, ...] = ("r2",)
    criterion: str = "mean_squared_error"

    def __call__(self, columns: dict[str, Array], response: Array, seconds: float, seed: int) -> Found:
        from pyoperon.sklearn import SymbolicRegressor

        model = SymbolicRegressor(
            allowed_symbols=self.symbols,
            optimizer_iterations=self.iterations,
            population_size=self.population,
            pool_size=self.population,
            max_length=self.length,
            objectives=list(self.objectives),
            generations=1_000_000,
            max_evaluations=10**9,
            max_time=max(1, round(seconds * slowdown())),
            epsilon=1e-12,
            model_selection_criterion=self.criterion,
            n_threads=1,
            random_state=seed,
        )
        model.fit(np.column_stack(list(columns.values())), response)
        return Found(lambda new: np.asarray(model.predict(np.column_stack(list(new.values()))), dtype=float))


PUBLISHED = {
    "ten steps, error alone": Operon(),
    "SRBench 2022: five steps, population 500": Operon(iterations=5, population=500),
    "SRBench 2025: one step, error and length": Operon(LARGEST_SET, iterations=1, objectives=("r2", "length")),
    "its example: ten steps, error and length": Operon(objectives=("r2", "length")),
}
"""Settings compared; symbols and what is not named are those of the first."""

OPERON = {"Operon": PUBLISHED["its example: ten steps, error and length"]}
"""Settings used by the other comparisons."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--every", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    chosen = parser.parse_args()
    from experiments.recovery.run import attempt, machine

    chosen.out.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[dict[str, object]]] = {name: [] for name in PUBLISHED}
    for law in halves()[0][1 :: chosen.every]:
        for name, settings in PUBLISHED.items():
            rows[name].append(attempt(replace(settings), law, 0, chosen.seconds, 0.0))
            print(name, rows[name][-1], flush=True)
        results = {
            "command": f"python -m experiments.recovery.operon --seconds {chosen.seconds:g} --every {chosen.every}",
            "machine": machine(),
            "settings": {
                name: {"solved": sum(bool(row["solved"]) for row in found), "of": len(found), "runs": found}
                for name, found in rows.items()
            },
        }
        (chosen.out / "operon.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    table = [(name, f"{sum(bool(row['solved']) for row in found)} of {len(found)}") for name, found in rows.items()]
    write_table(chosen.out / "README.md", "Operon", ("Operon's settings", "tune laws solved"), table)


if __name__ == "__main__":
    main()
