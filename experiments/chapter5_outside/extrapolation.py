"""Repeat Fig 5.8 on an independent simulator: errors of evolved programs at new poses.

The robots of `chapter5_outside.run`, the searches of `extrapolation.run`.
From the root of the repository: python -m experiments.chapter5_outside.extrapolation [--seeds 20] [--rounds 4]
[--population 8192] [--generations 150] [--slot_population 1024] [--slot_generations 40] [--first 0] [--out FOLDER]
"""

from __future__ import annotations

import io
from argparse import Namespace
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.chapter5 import options, save
from experiments.chapter5_outside.elastic_arm import PAYLOAD, PAYLOAD_CENTRE, POSES, TRAINING, table
from experiments.extrapolation.run import COLUMNS, columns_of
from experiments.extrapolation.run import one_robot as compensated
from experiments.irb6400r_truth import Case
from gpmodel.model.error_model import prepare
from gpmodel.table.blocks import hold_out

TAUGHT, MEAN, MAXIMUM = (COLUMNS.index(name) for name in ("train max", "held-out mean", "held-out max"))


def measured(seed: int) -> Case:
    """Robot number `seed` as its table has it, with the training poses that `discover` takes of it."""
    arm = gp.load_mechanism("irb6400r", f"{PAYLOAD:g} kg", payload_com=tuple(PAYLOAD_CENTRE))
    data = gp.read_table(pd.read_csv(io.StringIO(table(seed)), dtype=str), arm)
    train, heldout = hold_out(data, (POSES - TRAINING) / POSES, np.random.default_rng(seed))
    return Case(arm, prepare(arm, data), train, heldout, {})


def one_robot(seed: int, chosen: Namespace) -> dict[str, Any]:
    """COLUMNS of the standard model, of the best Cartesian program and of the slots' programs, mm."""
    errors, texts = compensated(measured(seed), chosen, np.random.default_rng([2003, 58, seed]))
    return {"robot": seed, "mm": columns_of(errors), "slot programs": texts}


def conclusions(robots: list[dict[str, Any]]) -> dict[str, str]:
    """On how many robots each holds."""
    before, tip, slot = (np.array([r["mm"][name] for r in robots]) for name in ("standard", "Cartesian", "slot"))
    gained = before - tip
    holds = {
        "the tip's program lowers the largest training error": tip[:, TAUGHT] < before[:, TAUGHT],
        "and raises the held-out mean": tip[:, MEAN] > before[:, MEAN],
        "and gains less than a tenth of that on the held-out maximum": gained[:, MAXIMUM] < 0.1 * gained[:, TAUGHT],
        "programs at the slots lower the held-out mean": slot[:, MEAN] < before[:, MEAN],
        "programs at the slots lower the held-out maximum": slot[:, MAXIMUM] < before[:, MAXIMUM],
    }
    return {name: f"{int(yes.sum())} of {len(robots)}" for name, yes in holds.items()}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    sizes = {"population": 8192, "generations": 150, "slot_population": 1024, "slot_generations": 40}
    chosen = options(__doc__, "chapter5_outside", arguments, "extrapolation", seeds=20, rounds=4, **sizes, first=0)
    robots: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        robots.append(one_robot(seed, chosen))
        print(robots[-1], flush=True)
        middle = {k: np.median([r["mm"][k] for r in robots], axis=0).round(4) for k in robots[0]["mm"]}
        results = {"conclusions": conclusions(robots), "columns": COLUMNS, "median_mm": middle, "robots": robots}
        save(chosen, results, {}, seeds=len(robots))
    return results


if __name__ == "__main__":
    main()
