"""Machines of one type with known mean, spread and outlier."""

from collections.abc import Container
from functools import cache
from pathlib import Path

import numpy as np

from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.planning.simulate import simulate
from gpmodel.table.cells import frame_of
from gpmodel.table.dataset import Dataset

MECHANISM = "irb6400r"
BASE, JOINT = "base_compliance", "joint_compliance J2"
TRUTH = {"base compliance": 3e-7, "joint compliance, J2": 2e-7}
SPREAD, GEOMETRY, NOISE = 0.15, 1e-4, 3e-5


@cache
def machines(seed: int, count: int, poses: int = 40, outlier: int | None = None) -> dict[str, Dataset]:
    """Tables by serial. outlier: the machine whose base is three times as soft as that of the type."""
    mechanism, rng = MechanismChoice(MECHANISM).load(), np.random.default_rng(seed)
    out = {}
    for k in range(count):
        soft = 1.0 + SPREAD * rng.normal(size=2)
        soft[0] *= 3.0 if k == outlier else 1.0
        effects = [f"{n}={v * f}" for n, v, f in zip((BASE, JOINT), TRUTH.values(), soft, strict=True)]
        q = random_poses(mechanism, poses, rng)
        out[f"R-{k + 1:02d}"] = simulate(mechanism, q, effects, rng, noise=NOISE, geometry_sigma=GEOMETRY).dataset
    return out


@cache
def curved(count: int, outlier: int, poses: int = 60) -> dict[str, Dataset]:
    """Tables by serial of machines whose joint 1 errs along a curve of its angle, 15 % more or less of one amplitude.
    outlier: the machine with a curve of its own."""
    mechanism, rng = MechanismChoice(MECHANISM).load(), np.random.default_rng(6)
    slot, axis, _ = next(joint for joint in mechanism.joints if joint.name == "J1").drive[0]
    out = {}
    for k in range(count):
        effects = [f"{slot}:{axis}:sin(2*J1)={1e-4 * (1.0 + SPREAD * rng.normal())} rad"]
        effects += [f"{slot}:{axis}:cos(3*J1)=0.0004 rad"] if k == outlier else []
        q = random_poses(mechanism, poses, rng)
        out[f"C-{k + 1}"] = simulate(mechanism, q, effects, rng, noise=NOISE, geometry_sigma=GEOMETRY).dataset
    return out


ARM = """convention = "standard"
[[joint]]
d_mm = 300
alpha_deg = 90
[[joint]]
a_mm = 500
"""


def two_joint_arms(folder: Path, count: int, poses: int = 30, geared: Container[int] | None = None) -> Path:
    """A folder of machines of two joints, the second with one gear error, and of their description. geared: numbers of
    those that have it, all by default."""
    folder.mkdir()
    (folder / "arm.toml").write_text(ARM)
    (folder / "fleet.toml").write_text('mechanism = "arm.toml"\n')
    mechanism, rng = MechanismChoice(str(folder / "arm.toml")).load(), np.random.default_rng(2)
    for k in range(count):
        q = random_poses(mechanism, poses, rng)
        effects = ["gear_harmonic J2=200 arcsec"] if geared is None or k in geared else []
        made = simulate(
            mechanism, q, effects, rng, noise=NOISE, geometry_sigma=GEOMETRY
        ).dataset  # fmt: skip
        frame_of(made, mechanism).to_csv(folder / f"A-{k + 1}.csv", index=False)
    return folder


def written(folder: Path, tables: dict[str, Dataset]) -> Path:
    """The tables as files of a folder."""
    folder.mkdir(exist_ok=True)
    mechanism = MechanismChoice(MECHANISM).load()
    for serial, dataset in tables.items():
        frame_of(dataset, mechanism).to_csv(folder / f"{serial}.csv", index=False)
    return folder
