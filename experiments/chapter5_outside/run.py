"""Chapter 5 with a truth from outside: twenty elastic robots, given to `gpmodel discover` as tables.

From the root of the repository: python -m experiments.chapter5_outside.run [--robots 20] [--silent 5] [--minutes 0.3]
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from experiments.chapter5_outside.elastic_arm import PAYLOAD, PAYLOAD_CENTRE, POSES, TRAINING, table

HERE = Path(__file__).parent
PROGRAM = (sys.executable, "-c", "from gpmodel.cli.main import main; main()")
HAND_MADE = ("base_compliance", "joint_compliance J5")
CARRIED = ("--payload", f"{PAYLOAD:g}kg", "--payload-com", ",".join(f"{1e3 * v:g}mm" for v in PAYLOAD_CENTRE))
LATEST = {"base": 1, "J5": 2, "J4": 3}


def gpmodel(command: str, file: Path, seed: int, *options: str) -> dict[str, Any]:
    """report.json of one command, which is told of the table, the arm's name and what it carries."""
    out = file.parent / command
    held = ("--holdout", str((POSES - TRAINING) / POSES), "--seed", str(seed), "--quiet", "--out", str(out))
    line = [
        sys.executable,
        "-c",
        "from gpmodel.cli.main import main; main()",
        command,
        str(file),
        "--mechanism",
        "irb6400r",
    ]
    subprocess.run([*line, *CARRIED, *held, *options], check=True)
    report: dict[str, Any] = json.loads((out / "report.json").read_text())
    return report


def role(effect: dict[str, Any]) -> str:
    """base, J5 or J4 for the three springs that are there, else the effect's own name."""
    if effect["catalogue"] == "base_compliance":
        return "base"
    if effect["catalogue"] == "joint_compliance":
        return str(effect["slot"]).split(".")[0]
    return str(effect["name"])


def one_robot(seed: int, planted: bool, minutes: float) -> dict[str, Any]:
    """What the loop names, in its order, and the held-out errors [mm] of every step; of the hand-made model as well."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "table.csv"
        file.write_text(table(seed, planted), encoding="utf-8")
        found = gpmodel("discover", file, seed, "--minutes", str(minutes), "--workers", "1")
        hand = gpmodel("calibrate", file, seed, *(w for name in HAND_MADE for w in ("--effect", name)))
    return {
        "seed": seed,
        "planted": planted,
        "named": list(dict.fromkeys(role(e) for e in found["effects"])),
        "loop": [{"step": s["step"], **s["heldout"]} for s in found["ladder"]],
        "hand_made": [{"step": s["step"], **s["heldout"]} for s in hand["ladder"]],
        "verdict": found["verdict"],
        "versions": found["versions"],
    }


def conclusions(robots: list[dict[str, Any]]) -> dict[str, str]:
    """On how many robots each holds; a count of springs named before it says how late each may come."""
    bent, rigid = ([r for r in robots if r["planted"] is side] for side in (True, False))
    springs = [[n for n in r["named"] if n in LATEST] for r in bent]
    last = [(r["loop"][-1], r["hand_made"][-1]) for r in bent]
    holds = {
        "the base is the first spring named": [s[:1] == ["base"] for s in springs],
        "J5 is named after it": [s[1:2] == ["J5"] for s in springs],
        "J4 is named after that": [s[2:3] == ["J4"] for s in springs],
        "all three are named": [set(s) == set(LATEST) for s in springs],
        "held-out mean no worse than the hand-made model": [a["mean_mm"] <= b["mean_mm"] for a, b in last],
        "held-out maximum no worse than the hand-made model": [a["max_mm"] <= b["max_mm"] for a, b in last],
        "silent where nothing is planted": [not r["named"] for r in rigid],
    }
    return {name: f"{sum(yes)} of {len(yes)}" for name, yes in holds.items()}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(prog="python -m experiments.chapter5_outside.run", description=__doc__)
    for name, kind, default in (("robots", int, 20), ("silent", int, 5), ("minutes", float, 0.3), ("out", Path, HERE)):
        parser.add_argument(f"--{name}", type=kind, default=default)
    chosen = parser.parse_args(arguments)
    command = f"{parser.prog} --robots {chosen.robots} --silent {chosen.silent} --minutes {chosen.minutes:g}"
    robots: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for planted, count in ((True, chosen.robots), (False, chosen.silent)):
        for seed in range(count):
            robots.append(one_robot(seed, planted, chosen.minutes))
            print(robots[-1]["seed"], robots[-1]["named"], robots[-1]["loop"][-1]["mean_mm"], flush=True)
            medians = {
                k: float(np.median([r[k][-1]["mean_mm"] for r in robots if r["planted"]]))
                for k in ("loop", "hand_made")
            }
            results = {"command": command, "conclusions": conclusions(robots), "median_heldout_mean_mm": medians}
            (chosen.out / "results.json").write_text(json.dumps({**results, "robots": robots}, indent=1) + "\n")
    return {**results, "robots": robots}


if __name__ == "__main__":
    main()
