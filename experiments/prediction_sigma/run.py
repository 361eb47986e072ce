"""Measure the coverage of the sigma of a prediction if an effect is missing from the model.

Simulated robots have an effect outside the catalogue, and 0.03 mm noise. The standard model alone is fitted, or
`discover --runs 0` adds effects. The result is the share of coordinates of new exact positions within two sigma: of
parameters and discrepancy, and of the parameters alone.
From the root of the repository: python -m experiments.prediction_sigma.run [--robots 60] [--searched 8]
[--first 1000] --out FILE
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.options import command, parsed
from gpmodel.application.further import with_discrepancy
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.predict import coordinate_deviations, observed_by
from gpmodel.application.usable import usable
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.planning.simulate import simulate
from gpmodel.report.origin import versions
from gpmodel.table.cells import frame_of

NOISE, GEOMETRY, FRESH = 3e-5, 3e-4, 300
ROBOTS, POSES = ("ur5", "irb6400r", "panda"), (50, 80, 140)
SHAPES = (
    "tanh(2*sin({a} + 0.7))*cos({b})", "exp(-3*({a} - 0.3)**2)", "abs(sin({a} + 0.4))*sin({b})",
    "sin({a})*sin({b})*cos({c})", "1/(1.3 + sin({a} + {b}))",
)  # fmt: skip
SIZES = (0.0, 4e-5, 1e-4, 3e-4)
"""Amplitudes, rad: none; of the noise, three times and ten times it at a reach of a metre."""
Row = dict[str, Any]


def robot(number: int, size: float) -> tuple[str, Poses, Poses]:
    """A mechanism's name, measured poses of it, and fresh poses where it truly is."""
    name, count = ROBOTS[number % 3], POSES[number // 3 % 3]
    mechanism, rng = MechanismChoice(name).load(), np.random.default_rng(number)
    a, b, c = rng.choice([joint.name for joint in mechanism.joints][1:-1], 3, replace=False)
    shape = SHAPES[number // 9 % len(SHAPES)].format(a=a, b=b, c=c)
    effects = (f"{a}.moving:R{'xyz'[number % 3]}:{shape}={size} rad",) if size else ()
    q = random_poses(mechanism, count + FRESH, rng)
    exact = simulate(mechanism, q, effects=effects, noise=0.0, geometry_sigma=GEOMETRY, rng=rng).dataset
    noisy = replace(exact, position=exact.position + rng.normal(0.0, NOISE, exact.position.shape))
    measured, fresh = noisy.subset(np.arange(count)), exact.subset(np.arange(count, count + FRESH))
    return name, prepare(mechanism, measured), prepare(mechanism, fresh)


def covered(saved: SavedModel, fresh: Poses, poses: Poses, size: float) -> Row:
    """Share of fresh coordinates within two sigma, with the discrepancy and without, and their error, mm."""
    here, observed = observed_by(usable(saved), fresh)
    off = np.abs(observed.tip[:, :3, 3] - here.dataset.position)
    models = {"with": saved, "parameters alone": replace(saved, discrepancy=0.0)}
    shares = {k: float(np.mean(off < 2.0 * coordinate_deviations(m, here, observed))) for k, m in models.items()}
    return {"size": size, "poses": len(poses), **shares, "rms_mm": 1e3 * float(np.sqrt(np.mean(off**2)))}


def standard(number: int, size: float) -> Row:
    """The standard model alone, with the noise as it is estimated and as it is stated."""
    name, poses, fresh = robot(number, size)
    mechanism = MechanismChoice(name).load()
    fit = calibrate(ErrorModel(mechanism, geometric_effects(mechanism)), poses)
    saved = saved_model(fit, poses)
    told = covered(with_discrepancy(saved, fit, poses, noise=NOISE), fresh, poses, size)
    return covered(with_discrepancy(saved, fit, poses), fresh, poses, size) | {"noise stated": told["with"]}


def searched(number: int, size: float) -> Row:
    """Evaluate the model that `discover --runs 0` returns."""
    name, poses, fresh = robot(number, size)
    table = frame_of(poses.dataset, MechanismChoice(name).load())
    result = gp.discover(name, table, search=gp.Search(runs=0, workers=1))
    return covered(result.model.saved, fresh, poses, size) | {"effects": len(result.findings)}


def summed(rows: list[Row]) -> list[Row]:
    """Means by size of the effect."""
    by_size = {size: [r for r in rows if r["size"] == size] for size in sorted({r["size"] for r in rows})}
    return [
        {"robots": len(own), **{k: round(float(np.mean([r[k] for r in own])), 5) for k in own[0]}}
        for own in by_size.values()
    ]


if __name__ == "__main__":
    asked = parsed(__doc__, robots=60, searched=0, first=0, out=Path)
    numbers = [range(asked.first, asked.first + count) for count in (asked.robots, asked.searched)]
    found = {"standard": [standard(n, SIZES[n % 4]) for n in numbers[0]]}
    found["searched"] = [searched(n, SIZES[n % 4]) for n in numbers[1]]
    within = {f"{kind}, share of each": sorted(round(r["with"], 3) for r in rows) for kind, rows in found.items()}
    summary = {kind: summed(rows) for kind, rows in found.items()}
    asked.out.write_text(json.dumps({"command": command(), "versions": versions(), **summary, **within}, indent=1))
    print(json.dumps(summary, indent=1))
