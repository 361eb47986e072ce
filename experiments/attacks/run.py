"""Count hostile inputs that end neither in one clear line nor in a correct result.

A case is bad with a traceback, a "defect of gpmodel" (status 1), a refusal of more than one line, 30 s of processor
time, executed code of the value, an escape sequence or a forged verdict on the terminal.
From the root of the repository: python -m experiments.attacks.run [--cases 2000] [--seed 0] [--out FOLDER]
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import gpmodel as gp
from experiments.attacks.cases import Case, descriptions, options, saved, sights, tables
from experiments.options import parsed
from gpmodel.api.results import write_numbers
from gpmodel.cli.main import main as program
from gpmodel.files import to_json, write_text

HERE = Path(__file__).parent
LONGEST = 30.0
"""Seconds of CPU after which a case counts as hanging."""
FORGED = "fit to calibrate with; no warnings"
STATUSES = (0, 2, 3)


def bad(case: Case, folder: Path) -> str:
    """Why a case is bad; empty where it is not."""
    words = case.make(folder)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        done = CliRunner().invoke(program, words)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    said = done.stdout + done.stderr
    reasons = {
        f"status {done.exit_code}: {done.stderr[-200:]!r} {done.exception!r}": done.exit_code not in STATUSES,
        "a traceback": "Traceback" in said,
        f"{done.stderr.count(chr(10))} lines": done.exit_code == 2 and len(done.stderr.splitlines()) != 1,
        "unprintable characters": any(c not in "\n\t\xa0\u2009" and not c.isprintable() for c in said),
        "a forged verdict": said.splitlines().count(FORGED) > (words[0] == "check"),
        "code ran": bool(list(folder.rglob("CANARY"))),
    }
    return "; ".join(reason for reason, holds in reasons.items() if holds)


def slow(*_: object) -> None:
    raise TimeoutError(f"more than {LONGEST:g} s of CPU")


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    given = parsed(__doc__, arguments, cases=2000, seed=0, out=HERE)
    out, tried, found = given.out.resolve(), Counter[str](), []
    signal.signal(signal.SIGPROF, slow)
    with tempfile.TemporaryDirectory() as at:
        good, folder = Path(at) / "good", Path(at) / "case" / "in" / "here"
        made = gp.simulate("irb6400r", ["joint_compliance J2=2e-6"], poses=40, noise="0.03 mm", seed=1)
        fit = gp.calibrate("irb6400r", made.table, ["joint_compliance J2"], holdout=0)
        good.mkdir()
        write_numbers(fit.record, fit.model, good)
        made.to_dataframe().iloc[:, :9].to_csv(good / "t.csv", index=False)
        for seen in ("camera", "planes"):
            gp.simulate("irb6400r", poses=20, instrument=seen, seed=1).save(good / f"{seen}.csv")
        shutil.copytree(good, good / "before")
        contents = {name: json.loads((good / name).read_text()) for name in ("model.json", "report.json")}
        classes = [
            list(options()),
            list(tables()),
            list(descriptions()),
            list(sights()),
            *(list(saved(c, n)) for n, c in contents.items()),
        ]
        rng = np.random.default_rng(given.seed)
        for cases in classes:
            for k in rng.permutation(len(cases))[: given.cases // len(classes)].tolist():
                shutil.rmtree(folder, ignore_errors=True)
                shutil.copytree(good, folder)
                os.chdir(folder)
                tried[cases[k].name.split()[0]] += 1
                if reason := bad(cases[k], folder):
                    found.append({"case": cases[k].name, "why": reason})
                    print(found[-1], flush=True)
                os.chdir(at)
    results = {"command": f"python -m experiments.attacks.run --cases {given.cases} --seed {given.seed}",
               "possible": sum(map(len, classes)), "tried": dict(tried), "bad": found}  # fmt: skip
    write_text(out / "results.json", to_json(results))
    print(f"{len(found)} of {sum(tried.values())} bad; {time.process_time():.0f} s CPU")
    return results


if __name__ == "__main__":
    main()
