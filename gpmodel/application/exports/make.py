"""Everything a fitted model can be handed on as, each with its error against `predict`."""

import re
import shutil
import subprocess
import tempfile
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from gpmodel.application.exports.chain import chain_of
from gpmodel.application.exports.dh import Convention, dh_text
from gpmodel.application.exports.forward import Forward, forward_of
from gpmodel.application.exports.grid import NODES, Grid, lookup_grid
from gpmodel.application.exports.rigid import Rigid, refitted
from gpmodel.application.exports.sample import Place, fresh_poses
from gpmodel.application.exports.sources import c_text, header_text, latex_text, numpy_text, to_the_digits
from gpmodel.application.exports.urdf import measured_link, note_of, urdf_text
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.printing import DIGITS
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset
from gpmodel.table.write import table_text

URDF, GRID = "calibrated.urdf", "exports/grid.csv"
POSES = 300
"""Poses at which an export is held against `predict`: their RMS is known to 4 % (1 / √(2·300))."""
PRINTED = {"RMS": r"RMS (\S+) m", "largest": r"largest (\S+) m", "miss": r"miss (\S+) m", "us": r"(\S+) us"}
"""What the test in a C file prints."""
CASES = 20
"""Of these, written into the C file for the test of a compiler."""


@dataclass(frozen=True)
class Export:
    """A file, what it is, and its errors against `predict` on fresh poses within the measured ranges, m.

    heldout: RMS on held-out measured poses, m, where that is its own. missing: effects it cannot hold. rms, largest and
    heldout are NaN where they are not known.
    """

    file: str
    what: str
    text: str
    rms: float = np.nan
    largest: float = np.nan
    heldout: float = np.nan
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exports:
    """made: what the model allows. refused: by file, why there is none."""

    made: tuple[Export, ...]
    refused: Mapping[str, str]


def exports_of(
    saved: SavedModel, place: Place, *, box: Array | None = None, nodes: int = NODES, seed: int = 0
) -> Exports:
    """Every export that this model allows. place: of those that hold one set-up or tool. box, nodes: of the lookup
    grid, as `lookup_grid`."""
    rng = np.random.default_rng(seed)
    check = cache(lambda: Check.against(saved, place, place.poses(fresh_poses(saved, POSES, rng))))
    rigid = cache(lambda: refitted(saved))
    makers: dict[str, Callable[[str], Export]] = {
        URDF: lambda file: _urdf(file, rigid(), check()),
        "exports/dh_modified.toml": lambda file: _dh(file, "modified", rigid(), check()),
        "exports/dh_standard.toml": lambda file: _dh(file, "standard", rigid(), check()),
        "exports/model.py": lambda file: _numpy(file, check()),
        "exports/model.c": lambda file: _c(file, check()),
        "exports/model.h": lambda file: _header(file, check()),
        "exports/model.tex": lambda file: _latex(file, check()),
        GRID: lambda file: _grid(file, lookup_grid(saved, place, box, nodes, rng), nodes),
    }
    made, refused = [], {}
    unmeasured = [joint.name for joint in saved.mechanism.joints if not joint.measured]
    for file, make in makers.items():
        try:
            if unmeasured:
                raise InputError(f"{', '.join(unmeasured)} of {saved.mechanism.name} is not measured")
            made.append(make(file))
        except InputError as error:
            refused[file] = error.said
    return Exports(tuple(made), refused)


@dataclass(frozen=True)
class Check:
    """Fresh poses, the inputs (N, k) a forward model reads there, and the points (N, 3) that `predict` gives, m."""

    forward: Forward
    dataset: Dataset
    inputs: Array
    points: Array

    @classmethod
    def against(cls, saved: SavedModel, place: Place, dataset: Dataset) -> "Check":
        """The points of the model without the errors of the instrument and of the session."""
        forward = forward_of(saved, place)
        poses = prepare(saved.mechanism, dataset)
        kept = forward.saved
        points = observe(kept.model, poses, kept.theta, kept.placement).tip[:, :3, 3]
        columns = [dataset.payload if n == "payload" else poses.states[n] for n in forward.inputs]
        return cls(forward, dataset, np.column_stack(columns), points)

    def errors(self, points: Array) -> tuple[float, float]:
        """RMS and largest distance, m, of points (N, 3) from those predicted."""
        off = np.linalg.norm(points - self.points, axis=1)
        return root_mean_square(off), float(off.max())


def _urdf(file: str, rigid: Rigid, check: Check) -> Export:
    text = urdf_text(rigid, note_of(rigid))
    rms, largest = check.errors(_read_back(text, ".urdf", measured_link(text), rigid, check.dataset))
    what = "geometry, refitted without what a URDF cannot hold"
    return Export(file, what, text, rms, largest, root_mean_square(rigid.heldout), rigid.missing)


def _dh(file: str, convention: Convention, rigid: Rigid, check: Check) -> Export:
    mechanism = rigid.fit.model.mechanism
    text = dh_text(mechanism, chain_of(mechanism), rigid.twists, convention, note_of(rigid))
    rms, largest = check.errors(_read_back(text, ".toml", None, rigid, check.dataset))
    what = f"the same geometry as {convention} Denavit-Hartenberg rows"
    return Export(file, what, text, rms, largest, root_mean_square(rigid.heldout), rigid.missing)


def _read_back(text: str, suffix: str, frame: str | None, rigid: Rigid, dataset: Dataset) -> Array:
    """Points (N, 3) in the instrument's frame of the mechanism in a file of that text, moved as the measured one is:
    a URDF counts the motions themselves where the table has those of a parallel bar."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"read_back{suffix}"
        path.write_text(text, encoding="utf-8")
        mechanism = MechanismChoice(str(path), frame).load()
        moved = dataset.q @ chain_of(rigid.fit.model.mechanism).motions.T
        q: Array = np.linalg.lstsq(chain_of(mechanism).motions, moved.T, rcond=None)[0].T.astype(float)
        flange = se3.chain(mechanism.transforms(q))[-1]
    placed = rigid.fit.placement
    tool = np.stack([placed.tool[name] for name in dataset.label("tool").tolist()])
    register = np.stack([placed.registration[name] for name in dataset.label("setup").tolist()])
    return np.asarray((register @ flange @ tool)[:, :3, 3])


def _numpy(file: str, check: Check) -> Export:
    text = numpy_text(check.forward, _note(check.forward))
    rms, largest = check.errors(_executed(text, check))
    return Export(file, "the whole model as NumPy source", text, rms, largest, missing=check.forward.missing)


def _latex(file: str, check: Check) -> Export:
    rms, largest = check.errors(_executed(numpy_text(to_the_digits(check.forward), ""), check))
    text, what = (
        latex_text(check.forward),
        f"the terms as LaTeX, numbers to {DIGITS} digits, not held at the edges of their ranges",
    )
    return Export(file, what, text, rms, largest, missing=check.forward.missing)


def _executed(text: str, check: Check) -> Array:
    """Points (N, 3) that a NumPy source of ours predicts."""
    module = types.ModuleType("exported")
    exec(compile(text, "model.py", "exec"), module.__dict__)
    inputs = dict(zip(check.forward.inputs, check.inputs.T, strict=True))
    return np.asarray(module.predict(check.dataset.q, **inputs))


def _c(file: str, check: Check) -> Export:
    cases = np.hstack([check.dataset.q, check.inputs, check.points])[:CASES]
    text = c_text(check.forward, _note(check.forward), cases)
    found = tested(text)
    what = f"the whole model as C99, and its inverse; its own test compares it at {CASES} poses"
    return Export(file, what, text, found["RMS"], found["largest"], missing=check.forward.missing)


def _header(file: str, check: Check) -> Export:
    return Export(file, "declarations of model.c, for C and C++", header_text(check.forward, _note(check.forward)))


def tested(text: str) -> dict[str, float]:
    """What the test in a C file finds: `RMS` and `largest` difference, m, from the points in it, the largest `miss`, m,
    after its inverse, its time `us`; NaN where there is no compiler, or it refuses."""
    nothing = dict.fromkeys(("RMS", "largest", "miss", "us"), np.nan)
    compiler = shutil.which("cc")
    if compiler is None:
        return nothing
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder) / "model.c", Path(folder) / "model"
        source.write_text(text, encoding="utf-8")
        options = ["-std=c99", "-O2", "-DGPMODEL_TEST", str(source), "-lm", "-o", str(program)]
        done = subprocess.run([compiler, *options], capture_output=True, text=True, check=False)
        if done.returncode:
            return nothing
        said = subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout
    return {name: float(re.findall(pattern, said)[0]) for name, pattern in PRINTED.items()}


def _grid(file: str, grid: Grid, nodes: int) -> Export:
    what = (
        f"joint corrections at {nodes}³ nodes of a box, {100 * grid.reached:.0f} % of them reached; "
        f"without it {1e3 * root_mean_square(grid.before):.3g} mm RMS"
    )
    return Export(file, what, table_text(grid.nodes), root_mean_square(grid.error), float(grid.error.max()))


def _note(forward: Forward) -> str:
    left = f" Not in it: {'; '.join(forward.missing)}." if forward.missing else ""
    place = forward.place.said(forward.saved)
    return f"Model of {forward.saved.mechanism.name}, as gpmodel predict has it.{left}{place and f' {place}'}"
