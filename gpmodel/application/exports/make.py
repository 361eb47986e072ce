"""Make all exported files of a fitted model, each with its error against `predict` at unmeasured poses."""

import re
import shutil
import subprocess
import tempfile
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain
from pathlib import Path

import numpy as np

from gpmodel.application.exports.dh import Convention, dh_text, robodk_text
from gpmodel.application.exports.forward import Forward, chain_of, forward_of
from gpmodel.application.exports.grid import NODES, Grid, lookup_grid
from gpmodel.application.exports.reading import points_read
from gpmodel.application.exports.rigid import URDF, Rigid, follows, measured_link, note_of, refitted, urdf_text, written
from gpmodel.application.exports.ros import beyond, kinematics_text, last_ur_link, offsets_text, ur_text
from gpmodel.application.exports.sample import Place, fresh_poses
from gpmodel.application.exports.sources import c_text, header_text, latex_text, nameless, numpy_text, to_the_digits
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import at_end, check_finite, usable
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.expression import DIGITS
from gpmodel.mechanism.branches import branched
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.convention import axes_note
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class PredictedPoints:
    """Unmeasured poses, and the tool points, m, that `gpmodel predict` computes for the poses."""

    dataset: Dataset
    points: Array

    @classmethod
    def of(cls, saved: SavedModel, dataset: Dataset) -> "PredictedPoints":
        """Predict the tool points without errors of the instrument and of the measurement session."""
        kept = at_end(usable(saved))
        poses = prepare(saved.mechanism, replace(dataset, observations=()))
        return cls(dataset, observe(kept.model, poses, kept.theta, kept.placement).tip[:, :3, 3])

    def errors(self, points: Array) -> tuple[float, float]:
        """Return RMS and largest distance of points from the predicted points, m."""
        off = np.linalg.norm(points - self.points, axis=1)
        return root_mean_square(off), float(off.max())


@dataclass(frozen=True)
class Check:
    """Tool points predicted at some poses, and the inputs of an exported forward model at these poses."""

    forward: Forward
    predicted: PredictedPoints
    inputs: Array

    @classmethod
    def against(cls, saved: SavedModel, place: Place, dataset: Dataset) -> "Check":
        """Predict the tool points of a dataset and collect the inputs. Raises InputError if no forward model exists."""
        forward, states = forward_of(saved, place), prepare(saved.mechanism, dataset).states
        columns = [dataset.payload if n == "payload" else states[n] for n in forward.inputs]
        return cls(forward, PredictedPoints.of(saved, dataset), np.column_stack(columns))


GRID = "exports/grid.csv"
DH: dict[str, Convention] = {"exports/dh_modified.toml": "modified", "exports/dh_standard.toml": "standard"}
OF_URDF = (
    "exports/kinematics.yaml", "exports/joint_offsets.yaml", "exports/ur_kinematics.yaml", "exports/robodk.csv"
)  # fmt: skip
"""Exported files with the geometry of calibrated.urdf in other formats."""
HEADER = "declarations of model.c, for C and C++"
POSES = 1000
"""Number of poses at which an export is compared with `predict`. The RMS difference is known to 2 %, 1 / √(2·1000)."""
PRINTED = {"RMS": r"RMS (\S+) m", "largest": r"largest (\S+) m", "miss": r"miss (\S+) m", "us": r"(\S+) us"}
"""Patterns of the results that the self-test of a C file prints."""
CASES = 20
"""Number of poses written into the exported C file as test cases."""


@dataclass(frozen=True)
class Export:
    """Exported file, and its errors against `predict` at unmeasured poses within the measured ranges, m.

    file: path. what: description. text: content. heldout: RMS on held-out poses, m, if the geometry was refitted.
    missing: effects that the file cannot express. notes: notes on joint values and on the state of the machine. Errors
    that were not computed are NaN.
    """

    file: str
    what: str
    text: str
    rms: float = np.nan
    largest: float = np.nan
    heldout: float = np.nan
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exports:
    """The exported files of a model. refused: reason by name of each file that could not be made."""

    files: tuple[Export, ...]
    refused: Mapping[str, str]


def exports_of(
    saved: SavedModel, place: Place, *, box: Array | None = None, nodes: int = NODES, seed: int = 0
) -> Exports:
    """Return all exported files of a model. place: set-up and tool for formats that contain only one of each.

    box, nodes: limits and nodes of the lookup grid. Raises InputError if an effect is undefined at a fitted pose.
    """
    return merged([part() for part in parts_of(saved, place, box=box, nodes=nodes, seed=seed)])


def parts_of(
    saved: SavedModel, place: Place, *, box: Array | None = None, nodes: int = NODES, seed: int = 0
) -> list[Callable[[], Exports]]:
    """Return the exports as functions to run in parallel; one function makes all files from one fit or source text."""
    if saved.measured is not None:
        check_finite(saved, prepare(saved.mechanism, saved.measured.dataset))

    def fresh() -> Dataset:
        """Return unmeasured poses, equal on every call, because several parallel exports call the function."""
        return fresh_poses(saved, POSES, np.random.default_rng(seed))

    check = cache(lambda: Check.against(saved, place, place.poses(fresh())))
    rigid = cache(lambda: refitted(saved))
    several = branched(saved.mechanism) is not None
    geometry = cache(lambda: PredictedPoints.of(saved, fresh()) if several else check().predicted)
    urdf = cache(lambda: as_urdf(rigid(), geometry()))

    def grid() -> Grid:
        return lookup_grid(saved, place, box, nodes, np.random.default_rng([seed, 1]))

    makers: tuple[dict[str, Callable[[str], Export]], ...] = (
        {
            URDF: lambda file: urdf(),
            **dict.fromkeys(DH, lambda file: _dh(file, rigid(), check().predicted)),
            **dict.fromkeys(OF_URDF, lambda file: of_urdf(file, rigid(), urdf().text, geometry())),
        },
        {
            "exports/model.py": lambda file: _numpy(file, check()),
            "exports/model.c": lambda file: _c(file, check()),
            "exports/model.h": lambda file: Export(file, HEADER, header_text(check().forward, _note(check().forward))),
        },
        {"exports/model.tex": lambda file: _latex(file, check())},
        {GRID: lambda file: _grid(file, grid(), nodes)},
    )
    return [partial(_made, saved, part) for part in makers]


def merged(parts: Iterable[Exports]) -> Exports:
    """Merge the exported files of all parallel parts."""
    every = tuple(parts)
    made = chain.from_iterable(part.files for part in every)
    return Exports(tuple(made), {file: why for part in every for file, why in part.refused.items()})


def _made(saved: SavedModel, makers: Mapping[str, Callable[[str], Export]]) -> Exports:
    """Make the export files that the model allows, and collect the reasons for refused files."""
    made, refused = [], {}
    unmeasured = [joint.name for joint in saved.mechanism.joints if not joint.measured]
    for file, make in makers.items():
        try:
            if unmeasured:
                raise InputError(
                    f"{', '.join(unmeasured)} of {saved.mechanism.name} is not measured; expected a "
                    "mechanism with measured joints"
                )
            made.append(make(file))
        except InputError as error:
            refused[file] = error.said
    said = axes_note(saved.convention)
    return Exports(tuple(replace(export, notes=(*export.notes, said)) for export in made), refused)


def as_urdf(rigid: Rigid, predicted: PredictedPoints) -> Export:
    """Return the refitted geometry as URDF, from which the ROS and RoboDK files are derived."""
    return _geometry(URDF, "as a URDF", urdf_text(rigid, note_of(rigid, URDF)), rigid, predicted)


def _dh(file: str, rigid: Rigid, predicted: PredictedPoints) -> Export:
    mechanism = rigid.mechanism
    text = dh_text(mechanism, chain_of(mechanism), rigid.twists, DH[file], note_of(rigid, file))
    return _geometry(file, f"as {DH[file]} Denavit-Hartenberg rows", text, rigid, predicted)


def of_urdf(file: str, rigid: Rigid, urdf: str, predicted: PredictedPoints) -> Export:
    """Return one export file derived from the refitted geometry and its URDF."""
    text, what = _beside(file, rigid, urdf)
    return _geometry(file, what, text, rigid, predicted)


def _geometry(file: str, what: str, text: str, rigid: Rigid, predicted: PredictedPoints) -> Export:
    """Return an export file of the refitted geometry, with errors computed from the text of the file."""
    errors = predicted.errors(points_read(file, text, rigid, predicted.dataset))
    heldout, said = root_mean_square(rigid.heldout), follows(rigid.mechanism, file)
    return Export(file, f"the refitted geometry {what}", text, *errors, heldout, rigid.missing, said)


def _beside(file: str, rigid: Rigid, urdf: str) -> tuple[str, str]:
    """Return text and description of an export file derived from a URDF."""
    mechanism, (nominal, link) = rigid.mechanism, written(rigid.mechanism, {})
    if file == "exports/robodk.csv":
        note = note_of(rigid, file, "the last frame")
        return robodk_text(mechanism, chain_of(mechanism), rigid.twists, note), "as RoboDK's table"
    if file == "exports/ur_kinematics.yaml":
        if branched(mechanism):
            raise InputError(f"{mechanism.name} has several arms; expected one, as in ur_description")
        last = last_ur_link(urdf)
        note = note_of(rigid, file, last, {last: beyond(urdf, last, measured_link(urdf))})
        return ur_text(nominal, urdf, note), "as the kinematics file of ur_description"
    links = zip(link.split(","), measured_link(urdf).split(","), strict=True)
    note = note_of(rigid, file, link, {there: beyond(urdf, there, measured) for there, measured in links})
    if file == "exports/kinematics.yaml":
        return kinematics_text(nominal, urdf, note), "as origins of joints, for xacro"
    return offsets_text(nominal, urdf, note), "as robot_calibration's offsets to the nominal URDF"


def _numpy(file: str, check: Check) -> Export:
    text = numpy_text(check.forward, _note(check.forward))
    rms, largest = check.predicted.errors(_executed(check.forward, check))
    return Export(file, "the whole model as NumPy source", text, rms, largest, missing=check.forward.missing)


def _latex(file: str, check: Check) -> Export:
    rms, largest = check.predicted.errors(_executed(to_the_digits(check.forward), check))
    what = f"the terms as LaTeX, numbers to {DIGITS} digits, not held at the edges of their ranges"
    return Export(file, what, latex_text(check.forward), rms, largest, missing=check.forward.missing)


def _executed(forward: Forward, check: Check) -> Array:
    """Return the tool points, m, that the exported NumPy source predicts; the source is run without names from the
    table."""
    module = types.ModuleType("exported")
    exec(compile(numpy_text(nameless(forward), ""), "model.py", "exec"), module.__dict__)
    inputs = dict(zip(forward.inputs, check.inputs.T, strict=True))
    return np.asarray(module.predict(check.predicted.dataset.q, **inputs))


def _c(file: str, check: Check) -> Export:
    cases = np.hstack([check.predicted.dataset.q, check.inputs, check.predicted.points])[:CASES]
    text = c_text(check.forward, _note(check.forward), cases)
    found = tested(c_text(nameless(check.forward), "", cases))
    what = f"the whole model as C99, and its inverse; its own test compares it at {CASES} poses"
    return Export(file, what, text, found["RMS"], found["largest"], missing=check.forward.missing)


def tested(text: str) -> dict[str, float]:
    """Compile a C file and run its self-test.

    Returns the `RMS` and `largest` difference, m, from the points in the file, the largest error `miss`, m, after its
    inverse, and the computing time `us`. The values are NaN without a compiler, or if the compiler rejects the file.
    """
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
    said = (f"valid at {grid.state}",) if grid.state else ()
    return Export(file, what, grid.text, root_mean_square(grid.error), float(grid.error.max()), notes=said)


def _note(forward: Forward) -> str:
    left = f" Not in it: {'; '.join(forward.missing)}." if forward.missing else ""
    place, axes = forward.place.label(forward.saved), f" Convention: {axes_note(forward.saved.convention)}."
    return f"Model of {forward.saved.mechanism.name}, as gpmodel predict has it.{left}{place and f' {place}'}{axes}"
