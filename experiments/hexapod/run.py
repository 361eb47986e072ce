"""Test whether `discover` names the leg and the cyclic error of a hexapod with a bad screw.

python -m experiments.hexapod.run [--machines 10] [--innocent 5] [--out FOLDER]
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.hexapod.simulator import LEAD, table
from experiments.options import parsed
from gpmodel.evolution.linear import Linear
from gpmodel.report.origin import versions

HERE = Path(__file__).parent
SEARCH = gp.Search(runs=1, strategies=(Linear(),), workers=1, population=512, generations=15, climb=1)
"""Small runs of evolution: what is planted is of the catalogue."""


def one_machine(seed: int, planted: bool, search: gp.Search = SEARCH) -> dict[str, Any]:
    """Return the findings, the held-out rms [mm] of every step, and the truth."""
    text, machine = table(seed, planted)
    hexapod = gp.load_mechanism("hexapod")
    found = gp.discover(hexapod, pd.read_csv(io.StringIO(text), dtype=str), seed=seed, search=search)
    return {
        "seed": seed,
        "planted": planted,
        "truth": {"leg": f"L{machine.leg + 1}", "um": round(1e6 * machine.amplitude, 2), "waves a metre": 1 / LEAD},
        "found": [
            {"name": f.name, "inputs": list(f.inputs), "um": None if f.value is None else round(1e6 * f.value, 2)}
            for f in found.findings
        ],
        "heldout_mm": {s.step: round(s.heldout.rms_mm or np.nan, 6) for s in found.record.ladder},
    }


def right(machine: dict[str, Any]) -> bool:
    """Return whether all findings, at least one, are a cyclic error of the right leg."""
    of_leg = [f["inputs"] == [machine["truth"]["leg"]] and "cyclic error" in f["name"] for f in machine["found"]]
    return bool(of_leg) and all(of_leg)


def conclusions(machines: list[dict[str, Any]]) -> dict[str, str]:
    """On how many machines each holds."""
    bad = [m for m in machines if m["planted"]]
    last = [list(m["heldout_mm"].values())[-1] / m["heldout_mm"]["standard"] for m in bad]
    holds = {
        "the bad screw's cyclic error is named, and nothing else": [right(m) for m in bad],
        "as one wave": [len(m["found"]) == 1 for m in bad],
        "held-out rms at least 20 % below the standard model's": [ratio < 0.8 for ratio in last],
        "silent where every screw is good": [not m["found"] for m in machines if not m["planted"]],
    }
    return {name: f"{sum(yes)} of {len(yes)}" for name, yes in holds.items()}


def medians(machines: list[dict[str, Any]]) -> dict[str, float]:
    """Return medians of the held-out rms, um, over the machines with a bad screw: first, second and last step."""
    steps = [list(m["heldout_mm"].values()) for m in machines if m["planted"]]
    named = {"registration": 0, "standard": 1, "loop": -1}
    return {name: round(1e3 * float(np.median([s[k] for s in steps])), 2) for name, k in named.items()}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = parsed(__doc__, arguments, machines=10, innocent=5, out=HERE)
    cases = [(s, True) for s in range(chosen.machines)] + [(s, False) for s in range(chosen.innocent)]
    machines: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for seed, planted in cases:
        machines.append(one_machine(seed, planted))
        print(machines[-1], flush=True)
        command = f"python -m experiments.hexapod.run --machines {chosen.machines} --innocent {chosen.innocent}"
        head = {"command": command, "versions": versions(), "conclusions": conclusions(machines)}
        results = {**head, "median_heldout_rms_um": medians(machines), "machines": machines}
        (chosen.out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main()
