"""Twenty-four public laws recovered from 100 points: how many, how soon, and in exact form.

From the root of the repository: python -m experiments.recovery.run [--seconds 6] [--seeds 3] [--noise 0.0]
[--engines "linear, 4 registers solved;Operon"] [--out FOLDER]
Seconds are of one processor core: a busy machine is measured first and given longer. Solved: normalised mean
squared error below 1e-8 on 1000 points not trained on (with noise: below a tenth of the noise's variance).
Results of engines run before stay in the file beside the new ones.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import sympy

from experiments.recovery.engines import Found, available
from experiments.recovery.laws import LAWS, Law
from gpmodel.formula.algebra import to_sympy


def slowdown() -> float:
    """Wall seconds a second of one core's work takes now."""
    begin, used = time.perf_counter(), time.thread_time()
    while time.thread_time() - used < 0.2:
        pass
    return max(1.0, (time.perf_counter() - begin) / 0.2)


def is_exact(found: Found, law: Law) -> bool:
    """Whether program and law agree to 30 digits once coefficients within 1e-10 of simple numbers become these."""
    if found.program is None:
        return False
    names = {name: sympy.Symbol(name, real=True) for name in law.ranges}
    truth = sympy.sympify(law.text, locals=names)
    simple = [
        sympy.nsimplify(c, [sympy.sqrt(2 * sympy.pi)], tolerance=1e-10) if abs(c) > 1e-9 else sympy.Integer(0)
        for c in found.coefficients
    ]
    terms = [*to_sympy(found.program), sympy.Integer(1)]
    guess = sum(c * term for c, term in zip(simple, terms, strict=True))
    rng = np.random.default_rng(0)
    for _ in range(5):
        point = {names[k]: sympy.Rational(int(rng.uniform(*r) * 10**6), 10**6) for k, r in law.ranges.items()}
        exact, value = (sympy.N(expression.subs(point), 40) for expression in (truth, sympy.sympify(guess)))
        if not abs(value - exact) <= 1e-30 * (1 + abs(exact)):
            return False
    return True


def attempt(engine: Any, law: Law, seed: int, seconds: float, noise: float) -> dict[str, Any]:
    rng = np.random.default_rng(1000 + seed)
    columns, response = law.sample(100, rng)
    spread = response.std()
    noisy = response + noise * spread * rng.normal(size=100)
    new, truth = law.sample(1000, rng)
    begin = time.process_time()
    found = engine(columns, noisy, seconds * slowdown(), seed)
    used = time.process_time() - begin
    with np.errstate(all="ignore"):
        error = float(np.mean(np.square(found.predict(new) - truth)) / np.var(truth))
    limit = 1e-8 if noise == 0 else 0.1 * noise**2
    solved = bool(error < limit)
    return {
        "law": law.name, "seed": seed, "error": error, "solved": solved, "cpu_seconds": round(used, 2),
        "exact": bool(solved and noise == 0 and is_exact(found, law)),
        "found": None if found.program is None else str(found.program),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--engines", default=None)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    chosen = parser.parse_args()
    engines = available(noisy=chosen.noise > 0)
    names = list(engines) if chosen.engines is None else chosen.engines.split(";")
    file = chosen.out / ("results.json" if chosen.noise == 0 else f"results_noise_{chosen.noise:g}.json")
    results: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    chosen.out.mkdir(parents=True, exist_ok=True)
    for name in names:
        rows = []
        for law in LAWS:
            for seed in range(chosen.seeds):
                rows.append(attempt(engines[name], law, seed, chosen.seconds, chosen.noise))
                print(name, rows[-1], flush=True)
        times = [row["cpu_seconds"] for row in rows if row["solved"]]
        results[name] = {
            "command": f"python -m experiments.recovery.run --seconds {chosen.seconds:g} --seeds {chosen.seeds} "
            f'--noise {chosen.noise:g} --engines "{name}"',
            "solved": len(times),
            "of": len(rows),
            "exact": sum(row["exact"] for row in rows),
            "median_cpu_seconds_to_solve": float(np.median(times)) if times else None,
            "runs": rows,
        }
        file.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        print(name, {k: v for k, v in results[name].items() if k != "runs"}, flush=True)


if __name__ == "__main__":
    main()
