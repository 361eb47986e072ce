"""Compare the model that `gpmodel verify --next` repairs with a calibration of the changed arm from nothing.

The arms and changes of `experiments.verify.pose_by_pose`. Each check goes on to its end, and then by the poses that the
repaired model asks for. Errors are of the true point at 100 other random poses, without noise, less a registration.
From the root of the repository: python -m experiments.verify.repair [--robots 20]
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments.verify.pose_by_pose import SLIP, ZERO, Later, checked
from experiments.verify.run import ARM, NAMES, POSES, Robot, robot
from gpmodel.application.recheck import settled
from gpmodel.application.usable import usable
from gpmodel.files import to_json, write_text
from gpmodel.mechanism.branches import random_poses
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset

OTHERS, ROUNDS = 100, 3


def error(model: gp.Model, others: Dataset) -> float:
    """RMS error, mm, of a model at poses without noise, less a registration."""
    return 1e3 * root_mean_square(settled(usable(model.saved), others).errors)


def trials(robots: list[Robot], case: str) -> Iterator[dict[str, object]]:
    """Yield for each robot the poses and errors of the repaired model, first and at last, mm, and of a calibration."""
    for k, own in enumerate(robots):
        later = Later(own, k, **({"joint": 1 + k % 5, "moved": ZERO} if case == "zero" else {"slip": SLIP}))
        found, table = checked(own, later)
        rng = np.random.default_rng([k, 1])
        again, others = later.table(random_poses(ARM, POSES, rng)), later.table(random_poses(ARM, OTHERS, rng), False)
        anew = gp.calibrate(ARM, again, NAMES, holdout=0.0).model
        rounds: list[dict[str, float]] = []
        while found.repaired is not None and len(rounds) < ROUNDS:
            mm, expected = error(found.repaired.model, others), 1e3 * found.repaired.found.expected
            rounds.append({"poses": len(table), "mm": mm, "expected_mm": expected})
            if found.repaired.more is None or not len(found.repaired.more):
                break
            for q in np.radians(found.repaired.more.to_numpy()):
                table = later.measured(table, q)
            found = gp.verify_next(own.model, table)
        yield {"robot": k, "unrepaired_mm": error(own.model, others), "anew_mm": error(anew, others), "rounds": rounds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20)
    asked = parser.parse_args().robots
    robots = [robot(seed) for seed in range(asked)]
    out = {}
    for case in ("zero", "tool"):
        rows = out[case] = list(trials(robots, case))
        able = [r for r in rows if r["rounds"]]
        print(f"{case}: repaired {len(able)} of {len(rows)}")
        for name, part in (("first", 0), ("last", -1)):
            of = [r["rounds"][part] for r in able]
            ratios, poses = [r["mm"] / a["anew_mm"] for r, a in zip(of, able, strict=True)], [r["poses"] for r in of]
            expected = root_mean_square(np.array([r["mm"] / r["expected_mm"] for r in of]))
            print(f"  {name:<6} poses {min(poses)} to {max(poses)}, median {np.median(poses):.0f}; over a calibration "
                  f"median {np.median(ratios):.2f}, mean {np.mean(ratios):.2f}, largest {max(ratios):.2f}; "
                  f"over the expected error {expected:.2f} RMS", flush=True)  # fmt: skip
    write_text(Path(__file__).with_name("repair.json"), to_json({"command": f"--robots {asked}", "cases": out}))


if __name__ == "__main__":
    main()
