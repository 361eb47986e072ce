"""Count wrong tables that `gpmodel check` passes silently, and correct tables that it refuses.

A silent table is neither refused nor warned of. `calibrate` and `discover` refuse a table with an error of `check`.
From the root of the repository: python -m experiments.wrong_tables.run [--robots 10] [--sound 200] [--out FOLDER]
With --robots 0 the wrong tables of the last run are kept.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.options import parsed
from experiments.wrong_tables.kinds import ARMS, KINDS, Table, measured
from gpmodel.files import to_json, write_text
from gpmodel.texts import parse_json

HERE = Path(__file__).parent
OFFSETS = (0.1, 1.5e-3)
"""Metres that the reflector stands off the axis of the last joint, of every other robot."""
SOUND = [
    {"narrow": narrow, "sigma": sigma, "noise": noise, "poses": poses, "effects": effects, "offset": offset}
    for narrow, sigma, noise, poses, effects, offset in product(
        (1.0, 0.3, 0.1), (3e-4, 1e-3), (3e-5, 5e-4, 5e-6), (60, 25, 120), ((), ("base_compliance=1e-6",)), OFFSETS
    )
]
"""Wide and narrow poses, good and bad geometry, instruments, few and many poses, a soft base, the reflector's place."""
WRITTEN = [
    {"angle": angle, "length": length, "with_rotation": turned}
    for angle, length, turned in product(("deg", "rad"), ("mm", "m", "in", "um"), (False, True))
]
"""Units of a sound table, without and with orientations."""


def judged(table: Table) -> tuple[str, list[str]]:
    """Refused, unfit, warned or silent; and what is said."""
    try:
        found = gp.check(table.mechanism, table.frame())
    except gp.InputError as refused:
        return "refused", [str(refused)]
    said = [f"{f.severity}: {f.text}" for f in found.findings if f.severity != "note"]
    return "refused" if not found.valid else "unfit" if found.unfit else "warned" if said else "silent", said


def wrong(robots: int) -> dict[str, dict[str, Any]]:
    """By kind how many tables are judged so, and on which arms in silence."""
    out: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}
    for seed, arm in enumerate(ARMS[:robots]):
        table = measured(arm, seed, offset=OFFSETS[seed % 2])
        for number, (kind, change) in enumerate(KINDS.items()):
            verdict, _ = judged(change(table, np.random.default_rng([seed, number])))
            out[kind][verdict] = out[kind].get(verdict, 0) + 1
            if verdict == "silent":
                out[kind].setdefault("silent on", []).append(arm)
                print(arm, kind, "silent", flush=True)
    return out


def sound(count: int) -> tuple[dict[str, int], list[dict[str, Any]]]:
    """Count the verdicts on sound tables, and list the refused ones."""
    counts: Counter[str] = Counter()
    refused = []
    for seed in range(count):
        arm, how = ARMS[seed % len(ARMS)], SOUND[(7 * seed) % len(SOUND)]
        written = WRITTEN[seed // len(ARMS) % len(WRITTEN)]
        verdict, said = judged(replace(measured(arm, 1000 + seed, **how), **written))
        counts[verdict] += 1
        if verdict in ("refused", "unfit"):
            refused.append({"arm": arm, **how, **written, "said": said})
            print(refused[-1], flush=True)
    return dict(counts), refused


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    given = parsed(__doc__, arguments, robots=len(ARMS), sound=200, out=HERE)
    kinds = wrong(given.robots) if given.robots else parse_json((HERE / "results.json").read_text())["kinds"]
    good, refused = sound(given.sound)
    tables = sum(n for counts in kinds.values() for n in counts.values() if isinstance(n, int))
    silent = sum(counts.get("silent", 0) for counts in kinds.values())
    robots = given.robots or len(ARMS)
    results = {"command": f"python -m experiments.wrong_tables.run --robots {robots} --sound {given.sound}",
               "wrong tables": tables, "silent": silent, "kinds": kinds, "sound": good, "refused": refused}  # fmt: skip
    write_text(given.out / "results.json", to_json(results))
    print(f"{silent} of {tables} wrong tables silent; sound tables: {good}; {time.process_time():.0f} s CPU")
    return results


if __name__ == "__main__":
    main()
