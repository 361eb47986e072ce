"""The measured UR5: python -m experiments.ur5_measured.run --data FOLDER --out FOLDER [--results FILE].

Discovers on 700 poses of the grid with 300 held out, then fits what was found to all 1000 and predicts the 20 random
poses of the second file. The first fit's registration and tool hold for both files.
"""

from pathlib import Path

import numpy as np

from experiments import measured
from gpmodel.calibration import errors_on
from gpmodel.model import ErrorModel
from gpmodel.split import hold_out

HERE = Path(__file__).parent


def main() -> None:
    given = measured.settings(__doc__ or "")
    columns = HERE / "columns.toml"
    grid = measured.load(given.data / "3D_UR5_uncalibrated_grid_cleaned.csv", columns, "ur5")
    fresh = measured.load(given.data / "3D_UR5_uncalibrated_random_cleaned.csv", columns, "ur5")
    train, heldout = hold_out(grid.dataset, 0.3, np.random.default_rng(given.seed))
    found = measured.look("ur5", grid, train, heldout, given)
    effects = measured.found_effects(found, grid)
    models = {
        "registration": ErrorModel(found.mechanism, ()),
        "standard": measured.model_of(found, []),
        "found": measured.model_of(found, effects),
    }
    fits = {name: measured.fitted(model, grid) for name, model in models.items()}
    results = {
        "command": "python -m experiments.ur5_measured.run --data FOLDER --out FOLDER "
        f"--results experiments/ur5_measured/results.json --seed {given.seed} --runs {given.runs} "
        f"--representations {given.representations} --max-effects {given.max_effects}",
        "train": len(train),
        "stopped": found.stopped,
        "discovery_seconds": round(found.seconds),
        "heldout": measured.ladder(found, grid.subset(heldout)),
        "random_poses": {name: measured.statistics(errors_on(fit, fresh)) for name, fit in fits.items()},
    }
    measured.save(results, given.results)


if __name__ == "__main__":
    main()
