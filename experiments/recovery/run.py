"""Count the published formulas that are recovered from 100 points.

From the root of the repository: python -m experiments.recovery.run [--laws old|tune|unseen] [--seconds 5] [--seeds 3]
[--noise 0.0] [--engines "linear, under links;Operon"] [--out FOLDER]. It writes the tables of the README, too.
Laws: the 24 that all was tuned on once (old), or a half of 48 others drawn by a seed, to tune on or for a last look;
every look at the last is written to looks.json. Seconds are of one processor core: engines that only know the wall's
are given longer on a busy machine. Solved: normalised mean
squared error below 1e-8 on 1000 points not trained on (with noise: below a tenth of the noise's variance).
Results of engines run before stay in the file beside the new ones.
"""

import csv
import json
import os
import platform
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from experiments.options import parsed
from experiments.recovery.engines import available
from experiments.recovery.found import Found
from experiments.tables import write_table
from gpmodel.formula.algebra import to_sympy

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """A law, the uniform range of each variable, and its exact form as text for sympy."""

    name: str
    ranges: dict[str, tuple[float, float]]
    text: str

    def sample(self, points: int, rng: np.random.Generator) -> tuple[dict[str, Array], Array]:
        columns = {name: rng.uniform(*limits, points) for name, limits in self.ranges.items()}
        return columns, evaluate(self.text)(columns)


def evaluate(text: str) -> Callable[[dict[str, Array]], Array]:
    names = {name: getattr(np, name) for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "pi")}
    names["asin"] = np.arcsin
    return lambda columns: eval(text, {"__builtins__": {}}, {**names, **columns})


def _law(name: str, text: str, **ranges: tuple[float, float]) -> Law:
    return Law(name, ranges, text)


P = (1.0, 5.0)

LAWS = (
    _law("I.6.2a", "exp(-t**2/2)/sqrt(2*pi)", t=(1, 3)),
    _law("I.8.14", "sqrt((x2 - x1)**2 + (y2 - y1)**2)", x1=P, x2=P, y1=P, y2=P),
    _law("I.12.11", "q*(E + B*v*sin(t))", q=P, E=P, B=P, v=P, t=P),
    _law("I.13.12", "G*m1*m2*(1/r2 - 1/r1)", G=P, m1=P, m2=P, r1=P, r2=P),
    _law("I.16.6", "(u + v)/(1 + u*v/c**2)", c=P, u=P, v=P),
    _law("I.18.4", "(m1*r1 + m2*r2)/(m1 + m2)", m1=P, m2=P, r1=P, r2=P),
    _law("I.27.6", "1/(1/d1 + n/d2)", d1=P, d2=P, n=P),
    _law("I.29.16", "sqrt(x1**2 + x2**2 - 2*x1*x2*cos(t1 - t2))", x1=P, x2=P, t1=P, t2=P),
    _law("I.37.4", "i1 + i2 + 2*sqrt(i1*i2)*cos(d)", i1=P, i2=P, d=P),
    _law("I.40.1", "n*exp(-m*g*x/(k*T))", n=P, m=P, g=P, x=P, k=P, T=P),
    _law("I.44.4", "n*k*T*log(V2/V1)", n=P, k=P, T=P, V1=P, V2=P),
    _law("I.50.26", "x1*(cos(w*t) + a*cos(w*t)**2)", x1=(1, 3), w=(1, 3), t=(1, 3), a=(1, 3)),
    _law("bacres1", "20 - x - x*y/(1 + 0.5*x**2)", x=(0, 20), y=(0, 20)),
    _law("bacres2", "10 - x*y/(1 + 0.5*x**2)", x=(0, 20), y=(0, 20)),
    _law("barmag1", "0.5*sin(x - y) - sin(x)", x=(0, 6.283), y=(0, 6.283)),
    _law("barmag2", "0.5*sin(y - x) - sin(y)", x=(0, 6.283), y=(0, 6.283)),
    _law("glider1", "-0.05*x**2 - sin(y)", x=(1, 8), y=(-3, 3)),
    _law("glider2", "x - cos(y)/x", x=(1, 8), y=(-3, 3)),
    _law("lv1", "3*x - 2*x*y - x**2", x=(0, 8), y=(0, 3)),
    _law("predprey1", "x*(4 - x - y/(1 + x))", x=(0, 8), y=(0, 8)),
    _law("predprey2", "y*(x/(1 + x) - 0.075*y)", x=(0, 8), y=(0, 8)),
    _law("shearflow1", "cos(x)/tan(y)", x=(-3.14, 3.14), y=(0.2, 1.5)),
    _law("shearflow2", "(cos(y)**2 + 0.1*sin(y)**2)*sin(x)", x=(-3.14, 3.14), y=(-1.57, 1.57)),
    _law("vdp1", "10*(y - (x**3 - x)/3)", x=(-2, 2), y=(-1, 1)),
)


DRAWN, SEED = 48, 0


def others() -> tuple[Law, ...]:
    """All of the table, in its order."""
    with (Path(__file__).parent / "feynman.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    return tuple(Law(name, dict(map(_variable, ranges.split())), formula) for name, formula, ranges in rows)


def _variable(text: str) -> tuple[str, tuple[float, float]]:
    name, low, high = text.split(":")
    return name, (float(low), float(high))


def halves() -> tuple[tuple[Law, ...], tuple[Law, ...]]:
    """To tune on, and for a last look: 24 each of the 48 drawn by `SEED`."""
    laws = others()
    drawn = [laws[k] for k in np.random.default_rng(SEED).permutation(len(laws))[:DRAWN]]
    return tuple(drawn[: DRAWN // 2]), tuple(drawn[DRAWN // 2 :])


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
    laws_of = ("old", "tune", "unseen")
    chosen = parsed(__doc__, laws=laws_of, seconds=5.0, seeds=3, noise=0.0, engines="", out=Path(__file__).parent)
    engines = available(noisy=chosen.noise > 0)
    names = chosen.engines.split(";") if chosen.engines else list(engines)
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
