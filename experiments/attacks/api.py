"""Count wrong arguments of the Python interface that raise another exception than InputError.

A case is bad with another exception, an error of more than one line, or 30 s of processor time. An accepted value is
no fault. From the root of the repository: python -m experiments.attacks.api [--cases 600] [--seed 0] [--out FOLDER]
"""

from __future__ import annotations

import inspect
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.attacks.run import HERE, LONGEST, slow
from experiments.options import parsed
from gpmodel.files import to_json, write_text

VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 3.5, np.nan, np.inf, 10**400, 1j, np.float32(2.0), np.datetime64("2020-01-01"), "", "nan", "abc",
    "a\0b", "1 parsec", "9" * 5000, b"bytes", Path("missing"), Path(), [], {}, [[]], ["abc"], [None], [np.nan],
    (1, 2, 3), {"a": 1}, {"abc": [1, 2]}, object(), int, lambda *_: 1, range(3), iter(()), np.zeros((2, 3)),
    np.array("x"), np.array([object()]), pd.DataFrame(), pd.DataFrame({"J1 [deg]": [object()]}), pd.Series([1.0]),
    {1, 2}, Ellipsis, NotImplemented,
)  # fmt: skip
ADDED = ("command", "kept", "progress", "self")
"""Parameters that the program itself gives, and callbacks."""


@dataclass(frozen=True)
class Call:
    """A function and arguments with which it ends quickly."""

    name: str
    function: Callable[..., Any]
    usual: dict[str, Any]


def calls(good: Path) -> list[Call]:
    """Every function that takes what a user gives. Searches are given no table."""
    model, result, arm = gp.load_model(good / "model.json"), gp.load_result(good), "irb6400r"
    table, missing = pd.read_csv(good / "t.csv"), "missing.csv"
    usual: dict[str, dict[str, Any]] = {
        "calibrate": {"mechanism": arm, "table": table}, "check": {"mechanism": arm, "table": table},
        "discover": {"mechanism": arm, "table": missing}, "evolve": {"mechanism": arm, "table": missing},
        "fleet": {"mechanism": arm, "tables": missing}, "simulate": {"mechanism": arm, "poses": 3},
        "choose_poses": {"mechanism": arm, "count": 3}, "load_mechanism": {"source": arm},
        "load_model": {"file": good / "model.json"}, "load_result": {"folder": good},
        "read_table": {"table": table, "mechanism": arm}, "verify": {"model": model, "table": table},
        "verify_next": {"model": model, "table": table}, "compare": {"before": result, "after": result},
        "certificate": {"result": result}, "regress": {"X": np.zeros((9, 1)), "y": np.arange(9.0), "seconds": 0.01},
    }  # fmt: skip
    own = {"predict": {"poses": table}, "compensate": {"targets": table}, "misses": {"poses": table},
           "verify": {"table": table}, "export": {"nodes": 2}, "save": {"file": "m.json"},
           "program": {"corrected": model.compensate(table), "language": "RAPID"}}  # fmt: skip
    found = [Call(name, getattr(gp, name), words) for name, words in usual.items()]
    found += [Call(f"model.{name}", getattr(model, name), words) for name, words in own.items()]
    return [*found, *(Call(n, c, {}) for n, c in (("Search", gp.Search), ("Criteria", gp.Criteria)))]


def cases(good: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Every parameter of every call with every value."""
    for call in calls(good):
        for name, parameter in inspect.signature(call.function).parameters.items():
            if name in ADDED or parameter.kind in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL):
                continue
            for k, value in enumerate(VALUES):
                yield f"{call.name} {name} value {k}", partial(call.function, **(call.usual | {name: value}))


def bad(make: Callable[[], Any]) -> str:
    """Why a call is bad; empty where it is not."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        make()
    except gp.InputError as error:
        return "" if len(str(error).splitlines()) == 1 else f"lines: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:200]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return ""


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Draw so many of all cases and write api.json."""
    given = parsed(__doc__, arguments, cases=600, seed=0, out=HERE)
    out, found = given.out.resolve(), []
    signal.signal(signal.SIGPROF, slow)
    with tempfile.TemporaryDirectory() as at:
        os.chdir(at)
        made = gp.simulate("irb6400r", ["joint_compliance J2=2e-6"], poses=40, noise="0.03 mm", seed=1)
        fit = gp.calibrate("irb6400r", made.table, ["joint_compliance J2"], holdout=0)
        fit.report("good")
        made.to_dataframe().iloc[:, :9].to_csv("good/t.csv", index=False)
        every = list(cases(Path("good").resolve()))
        chosen = np.random.default_rng(given.seed).permutation(len(every))[: given.cases].tolist()
        for k in chosen:
            folder = Path(at) / "case"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            os.chdir(folder)
            name, make = every[k]
            if reason := bad(make):
                found.append({"case": name, "value": repr(VALUES[int(name.split()[-1])])[:60], "why": reason})
                print(found[-1], flush=True)
        with suppress(OSError):
            os.chdir(out)
    results = {"command": f"python -m experiments.attacks.api --cases {given.cases} --seed {given.seed}",
               "possible": len(every), "tried": len(chosen), "bad": found}  # fmt: skip
    write_text(out / "api.json", to_json(results))
    print(f"{len(found)} of {len(chosen)} bad; {time.process_time():.0f} s CPU")
    return results


if __name__ == "__main__":
    main()
