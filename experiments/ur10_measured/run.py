"""Search the measured UR10: python -m experiments.ur10_measured.run --data FOLDER --out FOLDER [--results FILE].

Looks at 400 random poses of series A, or as many as --look says; fits what was found to 1500, evaluates on all 10 411
others, on contiguous blocks and on series D.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from experiments import measured
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.state import Discovery
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses

HERE = Path(__file__).parent
SHOWN, TRAIN, BLOCKS = 200, 1500, 5


def blocks(found: Discovery, poses: Poses, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Each fifth of the session predicted from 1500 random poses of the other four fifths."""
    out = []
    everything = np.arange(len(poses))
    for k, block in enumerate(np.array_split(everything, BLOCKS)):
        train = np.sort(rng.permutation(np.setdiff1d(everything, block))[:TRAIN])
        row: dict[str, Any] = {"rows": [int(block[0]) + 1, int(block[-1]) + 1]}
        for name, effects in (("standard", []), ("found", measured.found_effects(found, poses.subset(train)))):
            fit = measured.fitted(measured.model_of(found, effects), poses.subset(train))
            row[name] = measured.statistics(errors_on(fit, poses.subset(block)))
        out.append(row)
        print(f"block {k + 1} of {BLOCKS}", file=sys.stderr)
    return out


def later(found: Discovery, frozen: list[tuple[Effect, ...]], poses: Poses, rng: np.random.Generator) -> dict[str, Any]:
    """Series D: fits to half of it, errors on the other half; the shapes of A frozen, one amplitude each."""
    order = rng.permutation(len(poses))
    train, test = poses.subset(np.sort(order[: len(order) // 2])), poses.subset(np.sort(order[len(order) // 2 :]))
    out: dict[str, Any] = {"train": len(train)}
    for name, effects in (("registration", None), ("standard", []), ("found in A, shapes frozen", frozen)):
        model = ErrorModel(found.mechanism, ()) if effects is None else measured.model_of(found, effects)
        fit = measured.fitted(model, train)
        out[name] = measured.statistics(errors_on(fit, test))
    out["amplitudes"] = [
        {"name": e.name, "value": fit.theta[i], "stderr": fit.stderr[i]}
        for i, e in enumerate(fit.model.effects)
        if (e,) in frozen
    ]
    return out


def main() -> None:
    given = measured.settings(__doc__)
    rng = np.random.default_rng(given.seed)
    poses = measured.load(given.data / "Series_A" / "measurements_grid.csv", HERE / "columns.toml", "ur10")
    order = rng.permutation(len(poses))
    rows = np.sort(order[: given.look + SHOWN])
    look = np.flatnonzero(np.isin(rows, order[: given.look]))
    found = measured.look("ur10", poses.subset(rows), look, np.setdiff1d(np.arange(len(rows)), look), given)
    train, others = poses.subset(np.sort(order[:TRAIN])), poses.subset(np.sort(order[TRAIN:]))
    effects = measured.found_effects(found, train)
    models = {
        "registration": ErrorModel(found.mechanism, ()),
        "standard": measured.model_of(found, []),
        "found": measured.model_of(found, effects),
    }
    fits = {name: measured.fitted(model, train) for name, model in models.items()}
    series_d = measured.load(given.data / "Series_D" / "measurements_iso_cubes.csv", HERE / "columns.toml", "ur10")
    results = {
        "command": "python -m experiments.ur10_measured.run --data FOLDER --out FOLDER "
        f"--results {given.results} --seed {given.seed} --runs {given.runs} "
        f"--representations {given.representations} --max-effects {given.max_effects} --look {given.look}",
        "discovery": {"poses": given.look, "seconds": round(found.seconds), "stopped": found.stopped},
        "after_discovery": measured.ladder(found, others),
        "fitted_to": TRAIN,
        "heldout": {name: measured.statistics(errors_on(fit, others)) for name, fit in fits.items()},
        "blocks": blocks(found, poses, rng),
        "series_d": later(found, measured.frozen(found, effects, fits["found"]), series_d, rng),
    }
    measured.save(results, given.results)


if __name__ == "__main__":
    main()
