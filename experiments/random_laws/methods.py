"""Methods that learn from a measured table where a robot's tool is at other poses.

A method is a function from the table (csv), the description (urdf) and the poses (csv without positions) to an
`Answer`.  Another one is entered as `--method package.module:function`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.simulator import Array
from gpmodel.report.schema_search import EffectRecord

POSITION = ["x [mm]", "y [mm]", "z [mm]"]


@dataclass(frozen=True)
class Answer:
    """positions (N, 3), m, in the instrument's frame; findings: what the method adds to the geometry, where it says."""

    positions: Array
    findings: tuple[EffectRecord, ...] | None = None


Method = Callable[[Path, Path, Path], Answer]


def predicted(model: gp.Model, poses: Path) -> Array:
    """(N, 3) m of a fitted model, for poses of the same session, measured or not."""
    frame = pd.read_csv(poses).drop(columns=POSITION, errors="ignore")
    return np.asarray(1e-3 * model.predict(frame, session=True)[POSITION].to_numpy())


def geometry(table: Path, urdf: Path, poses: Path) -> Answer:
    """Registration, tool and the standard model alone."""
    return Answer(predicted(gp.calibrate(urdf, table, holdout=0.0).model, poses))


def discover(table: Path, urdf: Path, poses: Path) -> Answer:
    """The whole loop as it is shipped."""
    result = gp.discover(urdf, table)
    return Answer(predicted(result.model, poses), result.findings)


PEERS = "experiments.random_laws.peers"
METHODS = {
    "geometry": "experiments.random_laws.methods:geometry",
    "discover": "experiments.random_laws.methods:discover",
    "pybotics": f"{PEERS}:pybotics_geometry",
    "gaussian process": f"{PEERS}:gaussian_process",
    "symbolic regression": f"{PEERS}:symbolic_regression",
}


def method_named(name: str) -> Method:
    """One of `METHODS`, or a function written as package.module:function."""
    module, colon, function = METHODS.get(name, name).partition(":")
    if not colon:
        raise SystemExit(f"no method {name!r}; there are {', '.join(METHODS)}, or package.module:function")
    found: Method = getattr(import_module(module), function)
    return found
