"""The measured UR10: python -m experiments.ur10_measured.run --data FOLDER --out FOLDER [--results FILE].

Trains on 1500 random poses of series A, evaluates on all 10 411 others, on contiguous blocks, and on series D.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from experiments import measured
from gpmodel.calibration import errors_on
from gpmodel.discovery import Discovery
from gpmodel.model import Poses

HERE = Path(__file__).parent
TRAIN, SHOWN, BLOCKS = 1500, 500, 5


def blocks(found: Discovery, poses: Poses, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Each fifth of the session predicted from 1500 random poses of the other four fifths."""
    out = []
    everything = np.arange(len(poses))
    for k, block in enumerate(np.array_split(everything, BLOCKS)):
        train = np.sort(rng.permutation(np.setdiff1d(everything, block))[:TRAIN])
        row: dict[str, Any] = {"rows": [int(block[0]) + 1, int(block[-1]) + 1]}
        for name, effects in (("standard", []), ("found", measured.found_effects(found))):
            fit = measured.fitted(measured.model_of(found, effects), poses.subset(train))
            row[name] = measured.statistics(errors_on(fit, poses.subset(block)))
        out.append(row)
        print(f"block {k + 1} of {BLOCKS}", file=sys.stderr)
    return out


def later(found: Discovery, poses: Poses, rng: np.random.Generator) -> dict[str, Any]:
    """Series D: fits to half of it, errors on the other half; the found shapes frozen, one amplitude each."""
    order = rng.permutation(len(poses))
    train, test = poses.subset(np.sort(order[: len(order) // 2])), poses.subset(np.sort(order[len(order) // 2 :]))
    out: dict[str, Any] = {"train": len(train)}
    frozen = measured.frozen(found)
    for name, effects in (("registration", None), ("standard", []), ("found in A, shapes frozen", frozen)):
        model = measured.ErrorModel(found.mechanism, ()) if effects is None else measured.model_of(found, effects)
        fit = measured.fitted(model, train)
        out[name] = measured.statistics(errors_on(fit, test))
    out["amplitudes"] = [
        {"name": e.name, "value": fit.theta[i], "stderr": fit.stderr[i]}
        for i, e in enumerate(fit.model.effects)
        if e in frozen
    ]
    return out


def main() -> None:
    given = measured.settings(__doc__ or "")
    rng = np.random.default_rng(given.seed)
    poses = measured.load(given.data / "Series_A" / "measurements_grid.csv", HERE / "columns.toml", "ur10")
    order = rng.permutation(len(poses))
    rows = np.sort(order[: TRAIN + SHOWN])
    train = np.flatnonzero(np.isin(rows, order[:TRAIN]))
    found = measured.look("ur10", poses.subset(rows), train, np.setdiff1d(np.arange(len(rows)), train), given)
    others = poses.subset(np.sort(order[TRAIN:]))
    series_d = measured.load(given.data / "Series_D" / "measurements_iso_cubes.csv", HERE / "columns.toml", "ur10")
    results = {
        "command": "python -m experiments.ur10_measured.run --data FOLDER --out FOLDER "
        f"--results experiments/ur10_measured/results.json --seed {given.seed} --runs {given.runs}",
        "train": TRAIN,
        "stopped": found.stopped,
        "discovery_seconds": round(found.seconds),
        "heldout": measured.ladder(found, others),
        "blocks": blocks(found, poses, rng),
        "series_d": later(found, series_d, rng),
    }
    measured.save(results, given.results)


if __name__ == "__main__":
    main()
