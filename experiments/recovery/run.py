"""Public laws recovered from 100 points: how many, how soon, and in exact form.

From the root of the repository: python -m experiments.recovery.run [--laws old|tune|unseen] [--seconds 5] [--seeds 3]
[--noise 0.0] [--engines "linear, under links;Operon"] [--out FOLDER]. It writes the tables of the README, too.
Laws: the 24 that all was tuned on once (old), or a half of 48 others drawn by a seed, to tune on or for a last look;
every look at the last is written to looks.json. Seconds are of one processor core: engines that only know the wall's
are given longer on a busy machine. Solved: normalised mean
squared error below 1e-8 on 1000 points not trained on (with noise: below a tenth of the noise's variance).
Results of engines run before stay in the file beside the new ones.
"""

import argparse
import json
import os
import platform
import time
from contextlib import suppress
from datetime import UTC, datetime
from fractions import Fraction
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import sympy

from experiments.recovery.engines import available
from experiments.recovery.feynman import halves
from experiments.recovery.found import Found
from experiments.recovery.laws import LAWS, Law
from experiments.tables import write_table
from gpmodel.formula.algebra import to_sympy

ROOT = sympy.sqrt(2 * sympy.pi)
FACTORS = (sympy.Integer(1), sympy.pi, 1 / sympy.pi, sympy.pi**2, 1 / sympy.pi**2, ROOT, 1 / ROOT)


def simple(number: float) -> sympy.Expr:
    """The simple number within 1e-10 of it, relatively: a fraction times a power or root of pi; else itself."""
    for factor in FACTORS:
        part = Fraction(number / float(factor)).limit_denominator(1000)
        if part and abs(float(part) * float(factor) / number - 1.0) < 1e-10:
            return sympy.Rational(part.numerator, part.denominator) * factor
    return sympy.Float(number, 40)


def is_exact(found: Found, law: Law) -> bool:
    """Return whether program and truth agree to 30 digits after numbers within 1e-10 of simple ones are rounded to
    them.

    The program is tried as found and expanded, since expansion merges numbers.
    """
    if found.program is None:
        return False
    names = {name: sympy.Symbol(name, real=True) for name in law.ranges}
    truth = sympy.sympify(law.text, locals=names)
    terms = [*to_sympy(found.program), sympy.Integer(1)]
    coefficients = [simple(c) if abs(c) > 1e-9 else sympy.Integer(0) for c in found.coefficients]
    guess = sympy.sympify(sum(c * term for c, term in zip(coefficients, terms, strict=True)))
    return any(agree(with_simple_numbers(form), truth, names, law) for form in (guess, sympy.expand(guess)))


def with_simple_numbers(expression: sympy.Expr) -> sympy.Expr:
    """Every number near a simple one replaced by it."""
    return expression.xreplace({number: simple(float(number)) for number in expression.atoms(sympy.Float)})


def agree(guess: sympy.Expr, truth: sympy.Expr, names: dict[str, sympy.Symbol], law: Law) -> bool:
    """Return whether two expressions have 30 equal digits at five points."""
    rng = np.random.default_rng(0)
    for _ in range(5):
        point = {names[k]: sympy.Rational(int(rng.uniform(*r) * 10**6), 10**6) for k, r in law.ranges.items()}
        exact, value = (sympy.N(expression.subs(point), 40) for expression in (truth, guess))
        if not abs(value - exact) <= 1e-30 * (1 + abs(exact)):
            return False
    return True


OURS = "linear, under links"
LAWS_IN = {"": "old", "_tune": "tune", "_unseen": "unseen", "_noise_0.01": "old, 1 % noise"}
"""The laws of each file of results."""

WARM_UP = Law("warm-up", {"x": (1, 2), "y": (1, 2)}, "sin(x)*exp(y) + sin(3.3*y)*log(x)")
"""Problem that compiles the engines before timing."""


def attempt(engine: Any, law: Law, seed: int, seconds: float, noise: float) -> dict[str, Any]:
    rng = np.random.default_rng(1000 + seed)
    columns, response = law.sample(100, rng)
    spread = response.std()
    noisy = response + noise * spread * rng.normal(size=100)
    new, truth = law.sample(1000, rng)
    begin = time.process_time()
    found = engine(columns, noisy, seconds, seed)
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


def machine() -> dict[str, Any]:
    """Describe the machine, on which the numbers depend besides seeds."""
    found: dict[str, Any] = {"python": platform.python_version(), "cores": os.cpu_count(), "load": os.getloadavg()[0]}
    for package in ("gpmodel", "numpy", "numba", "pyoperon", "gplearn"):
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def record_look(folder: Path, engine: str, row: dict[str, Any]) -> None:
    """Add a look at the unseen half to the list of them."""
    file = folder / "looks.json"
    looks = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    looks.append({"at": f"{datetime.now(UTC):%Y-%m-%d %H:%M}", "engine": engine} | {
        key: row[key] for key in ("command", "solved", "of", "exact")
    })  # fmt: skip
    file.write_text(json.dumps(looks, indent=1) + "\n", encoding="utf-8")


def write_tables(folder: Path) -> None:
    """Write the tables of all results files into the README."""
    solved: list[tuple[object, ...]] = []
    missed: list[tuple[object, ...]] = []
    for kind in ("", "_tune", "_unseen", "_noise_0.01"):
        file = folder / f"results{kind}.json"
        found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        laws = LAWS_IN[kind]
        for engine, row in found.items():
            counts = f"{row['solved']} of {row['of']}", row["exact"] or None
            times = row["median_cpu_seconds_to_solve"], round(row["machine"]["load"], 1) if "machine" in row else None
            solved.append((laws, engine, row.get("seeds"), row.get("seconds"), *counts, *times))
        left = [row for row in found.get(OURS, {"runs": []})["runs"] if not row["solved"]]
        for law in dict.fromkeys(row["law"] for row in left):
            missed.append((laws, law, ", ".join(str(row["seed"]) for row in left if row["law"] == law)))
    header = ("laws", "engine", "seeds", "seconds", "solved", "exact", "median CPU-s to solve", "load")
    write_table(folder / "README.md", "solved", header, solved)
    write_table(folder / "README.md", "missed", ("laws", f"missed by {OURS!r}", "seeds"), missed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laws", choices=("old", "tune", "unseen"), default="old")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--engines", default=None)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    chosen = parser.parse_args()
    engines = available(noisy=chosen.noise > 0)
    names = list(engines) if chosen.engines is None else chosen.engines.split(";")
    laws = dict(zip(("tune", "unseen", "old"), (*halves(), LAWS), strict=True))[chosen.laws]
    kind = "" if chosen.laws == "old" else f"_{chosen.laws}"
    file = chosen.out / f"results{kind}{f'_noise_{chosen.noise:g}' if chosen.noise else ''}.json"
    chosen.out.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for name in names:
        attempt(engines[name], WARM_UP, 0, 1.0, chosen.noise)
        rows = []
        for law in laws:
            for seed in range(chosen.seeds):
                rows.append(attempt(engines[name], law, seed, chosen.seconds, chosen.noise))
                print(name, {k: v for k, v in rows[-1].items() if k != "found"}, flush=True)
        times = [row["cpu_seconds"] for row in rows if row["solved"]]
        results[name] = {
            "command": f"python -m experiments.recovery.run --laws {chosen.laws} --seconds {chosen.seconds:g} "
            f'--seeds {chosen.seeds} --noise {chosen.noise:g} --engines "{name}"',
            "machine": machine(),
            "seconds": chosen.seconds,
            "seeds": chosen.seeds,
            "solved": len(times),
            "of": len(rows),
            "exact": sum(row["exact"] for row in rows),
            "median_cpu_seconds_to_solve": float(np.median(times)) if times else None,
            "runs": rows,
        }
        file.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        write_tables(chosen.out)
        if chosen.laws == "unseen":
            record_look(chosen.out, name, results[name])
        print(name, {k: v for k, v in results[name].items() if k != "runs"}, flush=True)


if __name__ == "__main__":
    main()
