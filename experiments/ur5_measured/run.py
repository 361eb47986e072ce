"""Search the measured UR5: python -m experiments.ur5_measured.run --data FOLDER --out FOLDER [--results FILE].

Discovers on 700 poses of the grid with 300 held out, then fits what was found to all 1000 and predicts the 20 random
poses of the second file. The first fit's registration and tool hold for both files.
"""

from pathlib import Path
from typing import Any

import numpy as np

from experiments import measured
from gpmodel.application.model_file import load_model
from gpmodel.calibration.result import errors_on
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.table.blocks import hold_out

HERE = Path(__file__).parent


def random_poses(model_file: Path, grid: Poses, fresh: Poses) -> dict[str, Any]:
    """Errors on the random poses of models fitted to the whole grid.

    The order of the rows of one file means nothing in another, so what reads it does not belong there.
    """
    model = load_model(model_file).model
    models = {
        "registration": ErrorModel(model.mechanism, ()),
        "standard": ErrorModel(model.mechanism, tuple(e for e in model.effects if e.constant)),
        "found": model,
        "found, without what reads the row": ErrorModel(
            model.mechanism, tuple(e for e in model.effects if "row" not in e.inputs)
        ),
    }
    return {name: measured.statistics(errors_on(measured.fitted(m, grid), fresh)) for name, m in models.items()}


def main() -> None:
    given = measured.settings(__doc__)
    columns = HERE / "columns.toml"
    grid = measured.load(given.data / "3D_UR5_uncalibrated_grid_cleaned.csv", columns, "ur5")
    fresh = measured.load(given.data / "3D_UR5_uncalibrated_random_cleaned.csv", columns, "ur5")
    train, heldout = hold_out(grid.dataset, 0.3, np.random.default_rng(given.seed))
    found = measured.look("ur5", grid, train, heldout, given)
    results = {
        "command": "python -m experiments.ur5_measured.run --data FOLDER --out FOLDER "
        f"--results experiments/ur5_measured/results.json --seed {given.seed} --runs {given.runs} "
        f"--representations {given.representations} --max-effects {given.max_effects} --minutes {given.minutes:g}",
        "train": len(train),
        "stopped": found.stopped,
        "discovery_seconds": round(found.seconds),
        "heldout": measured.ladder(found, grid.subset(heldout)),
        "random_poses": random_poses(given.out / "model.json", grid, fresh),
    }
    measured.save(results, given.results)


if __name__ == "__main__":
    main()
