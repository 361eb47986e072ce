"""Repeat Chapter 5 on an independent simulator: elastic robots for `discover` and `calibrate`.

python -m experiments.chapter5_outside.run [--robots 20] [--rigid 5] [--processes 2]
"""

import io
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.chapter5_outside.elastic_arm import PAYLOAD, PAYLOAD_CENTRE, POSES, TRAINING, table
from experiments.options import parsed
from gpmodel.api.calibrate import CalibrationResult
from gpmodel.api.discover import DiscoveryResult
from gpmodel.evolution.linear import Linear
from gpmodel.executor import Forks
from gpmodel.report.origin import versions

HERE = Path(__file__).parent
HAND_MADE = ("base_compliance", "joint_compliance J5")
SPRINGS = ("base", "J5", "J4")
SEARCH = gp.Search(runs=1, strategies=(Linear(),), workers=1, population=512, generations=15, climb=1)
"""Small runs of evolution: what is planted is of the catalogue, and twenty robots take minutes."""


def as_json(result: DiscoveryResult | CalibrationResult) -> dict[str, Any]:
    """Return the content of report.json of a result."""
    with TemporaryDirectory() as folder:
        result.save(Path(folder) / "report.json")
        record: dict[str, Any] = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))
    return record


def role(effect: dict[str, Any]) -> str:
    """base, J5 or J4 for the three springs that are there, else the effect's own name."""
    family = effect["catalogue"]
    joint = str(effect["slot"]).split(".")[0]
    return {"base_compliance": "base", "joint_compliance": joint}.get(family, str(effect["name"]))


def one_robot(seed: int, planted: bool, search: gp.Search) -> dict[str, Any]:
    """Return the findings in order, and the held-out errors [mm] of every step and of the hand-made model."""
    arm = gp.load_mechanism("irb6400r", f"{PAYLOAD:g} kg", payload_com=tuple(PAYLOAD_CENTRE))
    frame = pd.read_csv(io.StringIO(table(seed, planted)), dtype=str)
    held = (POSES - TRAINING) / POSES
    found = as_json(gp.discover(arm, frame, holdout=held, seed=seed, search=search))
    hand = as_json(gp.calibrate(arm, frame, HAND_MADE, holdout=held, seed=seed))
    return {
        "seed": seed,
        "planted": planted,
        "named": list(dict.fromkeys(role(effect) for effect in found["effects"])),
        "loop": [{"step": s["step"], **s["heldout"]} for s in found["ladder"]],
        "hand_made": [{"step": s["step"], **s["heldout"]} for s in hand["ladder"]],
        "verdict": found["verdict"],
        "versions": found["versions"],
    }


def conclusions(robots: list[dict[str, Any]]) -> dict[str, str]:
    """On how many robots each holds."""
    bent = [r for r in robots if r["planted"]]
    springs = [[name for name in r["named"] if name in SPRINGS] for r in bent]
    last = [(r["loop"][-1], r["hand_made"][-1]) for r in bent]
    holds = {
        "the base is the first thing named": [r["named"][:1] == ["base"] for r in bent],
        "J5 is the next spring": [s[1:2] == ["J5"] for s in springs],
        "J4 is the one after that": [s[2:3] == ["J4"] for s in springs],
        "all three are named": [set(s) == set(SPRINGS) for s in springs],
        "held-out mean no worse than the hand-made model": [a["mean_mm"] <= b["mean_mm"] for a, b in last],
        "held-out maximum no worse than the hand-made model": [a["max_mm"] <= b["max_mm"] for a, b in last],
        "silent where nothing is planted": [not r["named"] for r in robots if not r["planted"]],
    }
    return {name: f"{sum(yes)} of {len(yes)}" for name, yes in holds.items()}


def median_mean(robots: list[dict[str, Any]], model: str, step: int) -> float:
    """Median over the bent robots of the held-out mean error [mm] of one step of `loop` or `hand_made`."""
    return round(float(np.median([r[model][step]["mean_mm"] for r in robots if r["planted"]])), 4)


def summary(robots: list[dict[str, Any]]) -> dict[str, Any]:
    """Summarise all robots for results.json."""
    steps = {"standard": ("loop", 1), "hand-made": ("hand_made", -1), "loop": ("loop", -1)}
    medians = {name: median_mean(robots, *step) for name, step in steps.items()}
    return {"conclusions": conclusions(robots), "median_heldout_mean_mm": medians, "robots": robots}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = parsed(__doc__, arguments, robots=20, rigid=5, processes=2, out=HERE)
    command = f"python -m experiments.chapter5_outside.run --robots {chosen.robots} --rigid {chosen.rigid}"
    jobs = [*((seed, True) for seed in range(chosen.robots)), *((seed, False) for seed in range(chosen.rigid))]
    found: dict[int, dict[str, Any]] = {}
    for number, robot in Forks(chosen.processes)(_one, jobs):
        found[number] = robot
        robots = [found[n] for n in sorted(found)]
        text = json.dumps({"command": command, "versions": versions(), **summary(robots)}, indent=1)
        (chosen.out / "results.json").write_text(f"{text}\n", encoding="utf-8")
        print(robot["seed"], robot["planted"], robot["named"], robot["loop"][-1]["mean_mm"], flush=True)
    return summary([found[n] for n in sorted(found)])


def _one(job: tuple[int, bool]) -> dict[str, Any]:
    return one_robot(*job, SEARCH)


if __name__ == "__main__":
    main()
