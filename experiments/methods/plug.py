"""The plug for a method that learns from a measured table where a robot's tool is at other poses.

A method is a function from the paths of the table (csv), the description (urdf) and the poses (csv without positions)
to positions (N, 3), m, in the instrument's frame, or to an `Answer`.  Another is entered as package.module:function.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.oracle import rms_mm
from experiments.blind.simulator import Array
from experiments.methods.rows import Row, explained
from gpmodel.discovery import formulas
from gpmodel.errors import GpModelError
from gpmodel.evolution.formulas import formulas_at
from gpmodel.report.schema_search import EffectRecord

POSITION = ["x [mm]", "y [mm]", "z [mm]"]
Files = tuple[Path, Path, Path]
"""Table, description and poses."""


@dataclass(frozen=True)
class Answer:
    """positions (N, 3), m, in the instrument's frame; findings: what the method adds to the geometry, where it says."""

    positions: Array
    findings: tuple[EffectRecord, ...] | None = None


Method = Callable[[Path, Path, Path], Answer | Array]


def predicted(model: gp.Model, poses: Path) -> Array:
    """(N, 3) m of a fitted model, for poses of the same session, measured or not."""
    frame = pd.read_csv(poses).drop(columns=POSITION, errors="ignore")
    return np.asarray(1e-3 * model.predict(frame, session=True, as_measured=True)[POSITION].to_numpy())


def geometry(table: Path, urdf: Path, poses: Path) -> Array:
    """Registration, tool and the standard model alone."""
    return predicted(gp.calibrate(urdf, table, holdout=0.0).model, poses)


def discover(table: Path, urdf: Path, poses: Path, search: gp.Search | None = None) -> Answer:
    """The whole loop as it is shipped, or searched otherwise."""
    result = gp.discover(urdf, table, search=search)
    return Answer(predicted(result.model, poses), result.findings)


def without_runs(table: Path, urdf: Path, poses: Path) -> Answer:
    """The loop without programs evolved at all sites: formulas are bred where smooth terms are selected."""
    return discover(table, urdf, poses, gp.Search(runs=0, workers=1))


def founders(table: Path, urdf: Path, poses: Path) -> Answer:
    """The loop without programs and without generations: formulas are the founders, shortened."""
    with patch.object(formulas, "formulas_at", partial(formulas_at, generations=0)):
        return without_runs(table, urdf, poses)


METHODS = {
    "geometry": ("experiments.methods.plug:geometry", ()),
    "discover": ("experiments.methods.plug:discover", ()),
    "without runs": ("experiments.methods.plug:without_runs", ()),
    "founders": ("experiments.methods.plug:founders", ()),
    "pybotics": ("experiments.methods.geometries:pybotics", ("pybotics",)),
    "figaroh": ("experiments.methods.geometries:figaroh", ("figaroh",)),
    "gaussian process": ("experiments.methods.regressions:gaussian_process", ("sklearn",)),
    "symbolic regression": ("experiments.methods.regressions:symbolic_regression", ("pyoperon",)),
}
"""By name: the function, and the packages without which it cannot run."""


def method_named(name: str) -> Method:
    """One of `METHODS`, or a function written as package.module:function."""
    target, needed = METHODS.get(name, (name, ()))
    module, colon, function = target.partition(":")
    if not colon:
        raise SystemExit(f"--method: {name!r}, expected {', '.join(METHODS)}, or package.module:function")
    if missing := [package for package in needed if find_spec(package) is None]:
        raise SystemExit(f"--method {name}: needs {', '.join(missing)}, see experiments/methods/README.md")
    try:
        found: Method = getattr(import_module(module), function)
    except (ImportError, AttributeError) as failure:
        raise SystemExit(f"--method: {failure}") from failure
    return found


def folder_name(name: str) -> str:
    """A method as a part of the name of a folder."""
    return name.replace(":", ".").replace(" ", "-")


def asked(method: Method, files: Files, true: Array, bounds: tuple[float, float]) -> tuple[Row, Answer | None]:
    """Run a method on one robot: 3-D rms at the poses against the true positions (N, 3), m, and its answer.

    bounds: errors of geometry and oracle, mm.  ratio: the method's error over the oracle's; explained:
    (g^2 - m^2) / (g^2 - o^2) of geometry, method and oracle, where these differ; failed: what it said instead.
    """
    started = time.perf_counter()
    try:
        given = method(*files)
        answer = given if isinstance(given, Answer) else Answer(np.asarray(given, dtype=float))
        if answer.positions.shape != true.shape or not np.isfinite(answer.positions).all():
            raise ValueError(f"positions {answer.positions.shape}, expected {true.shape}, all finite")
    except (GpModelError, ValueError, RuntimeError, np.linalg.LinAlgError) as failure:
        return {"failed": f"{type(failure).__name__}: {failure}"}, None
    seconds = round(time.perf_counter() - started, 1)
    error, (geometric, oracle) = rms_mm(answer.positions - true), bounds
    row: Row = {"seconds": seconds, "error_mm": error, "ratio": error / oracle}
    return row | ({"explained": explained(geometric, error, oracle)} if geometric != oracle else {}), answer
