"""Measure the coverage of every printed ± and interval, over strata of simulated machines.

From the root of the repository: python -m experiments.coverage.printed --machines 300 --out FILE
A repeated command continues. `--of fleets` simulates fleets of machines without an effect.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from experiments.coverage.asked import Row, asked
from experiments.coverage.fleets import fleet_asked
from experiments.coverage.truth import STRATA
from experiments.options import command, parsed
from experiments.tables import save_rows
from gpmodel.numerics.interval import coverage_factor

KINDS = ("effect", "geometry", "place", "turn", "tool")


def main() -> None:
    settings = parsed(__doc__, machines=300, first=0, stratum=("", *STRATA), of=tuple(ASKED), out=Path)
    rows: list[Row] = json.loads(settings.out.read_text())["machines"] if settings.out.exists() else []
    done = {row["machine"] for row in rows}
    ask, sum_up = ASKED[settings.of]
    for number in range(settings.first, settings.first + settings.machines):
        other = settings.stratum and list(STRATA)[number % len(STRATA)] != settings.stratum
        if number not in done and not other:
            rows.append(ask(number))
            save_rows(settings.out, {"command": command(), "summary": sum_up(rows)}, "machines", rows)
    print(json.dumps(sum_up(rows), indent=1))


def summarised(rows: list[Row]) -> dict[str, Any]:
    """Coverage over all machines, then by stratum."""
    out = {"all": covered(rows)}
    return out | {s: covered(own) for s in STRATA if (own := [row for row in rows if row["stratum"] == s])}


def covered(rows: list[Row]) -> dict[str, Any]:
    """Shares of numbers within k of their σ, of coordinates, of statements that hold; false changes."""
    out: dict[str, Any] = {"machines": len(rows)}
    for kind in KINDS:
        held = [abs(v) <= row["k"] for row in rows for v in row["z"].get(kind, [])]
        if held:
            out[kind] = _share(held)
    for kind in ("predicted", "compensated"):
        out[kind] = _share([row[kind] for row in rows if row[kind] is not None])
    said = [row for row in rows if row["said"]]
    for name in ("rms", "within_95", "largest"):
        out[f"{name} not exceeded"] = _share([r["there"][name] <= r["said"][name] for r in said])
    for name in ("ap", "rp"):
        if repeated := [abs(row[name]) <= 1.0 for row in rows if name in row]:
            out[f"{name} within U"] = _share(repeated)
    for name in ("width", "width_predicted"):
        out[name] = round(float(np.median([row[name] for row in rows])), 3)
    for level in (0.01, 0.05):
        out[f"verify, false at {level}"] = _share([row["verify"] < level for row in rows])
        out[f"compare, false at {level}"] = _share([row["change"] < level for row in rows])
    out["compare, one table"] = _share([row["same_changed"] > 0 for row in rows])
    out["verify, called changed"] = _share([row["verdict"] != "holds" for row in rows])
    without = [row["without_changed"] > 0 for row in rows if "without_changed" in row]
    out["compare, one table, other model"] = _share(without) if without else None
    return out


def _share(values: Any) -> float:
    return round(float(np.mean(values)), 4)


def of_fleets(rows: list[Row]) -> dict[str, Any]:
    """Fleets in which a machine stands out, means within two of their ±, spreads within their intervals."""
    groups = {"all": rows} | {
        f"{n} machines": [r for r in rows if r["size"] == n] for n in sorted({r["size"] for r in rows})
    }
    return {
        name: {
            "fleets": len(own), "with an outlier": _share([bool(r["outliers"]) for r in own]),
            "mean": _share([abs(z) <= coverage_factor(r["size"] - 1) for r in own for z in r["mean"]]),
            "spread": _share([s for r in own for s in r["spread"]]),
        }
        for name, own in groups.items()
    }  # fmt: skip


ASKED: dict[str, tuple[Callable[[int], Row], Callable[[list[Row]], dict[str, Any]]]] = {
    "machines": (asked, summarised), "fleets": (fleet_asked, of_fleets),
}  # fmt: skip


if __name__ == "__main__":
    main()
