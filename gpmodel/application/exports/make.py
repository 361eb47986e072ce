"""Everything a fitted model can be handed on as, each with its error against `predict`."""

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

from gpmodel.application.exports.against import Check, read_back, read_back_arms
from gpmodel.application.exports.chain import chain_of
from gpmodel.application.exports.dh import Convention, dh_text, robodk_text
from gpmodel.application.exports.forward import Forward
from gpmodel.application.exports.grid import NODES, Grid, lookup_grid
from gpmodel.application.exports.rigid import Rigid, measured_link, note_of, refitted, urdf_text, written
from gpmodel.application.exports.ros import beyond, kinematics_text, last_ur_link, offsets_text, ur_text
from gpmodel.application.exports.sample import Place, fresh_poses
from gpmodel.application.exports.sources import c_text, header_text, latex_text, nameless, numpy_text, to_the_digits
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import check_finite, usable
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.printing import DIGITS
from gpmodel.mechanism.branches import branched
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset
from gpmodel.table.write import table_text

GRID = "exports/grid.csv"
DH: dict[str, Convention] = {"exports/dh_modified.toml": "modified", "exports/dh_standard.toml": "standard"}
OF_URDF = (
    "exports/kinematics.yaml", "exports/joint_offsets.yaml", "exports/ur_kinematics.yaml", "exports/robodk.csv"
)  # fmt: skip
"""Files that hold what calibrated.urdf holds."""
HEADER = "declarations of model.c, for C and C++"
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
    grid, as `lookup_grid`. Raises InputError where an effect is undefined at the poses it was fitted to."""
    return together([part() for part in parts_of(saved, place, box=box, nodes=nodes, seed=seed)])


def parts_of(
    saved: SavedModel, place: Place, *, box: Array | None = None, nodes: int = NODES, seed: int = 0
) -> list[Callable[[], Exports]]:
    """The same in parts that may be made side by side: files of one fit or one source are one part."""
    if saved.measured is not None:
        check_finite(saved, prepare(saved.mechanism, saved.measured.dataset))
    fresh = partial(fresh_poses, saved, POSES, np.random.default_rng(seed))
    check = cache(lambda: Check.against(saved, place, place.poses(fresh())))
    rigid = cache(lambda: refitted(saved))
    urdf = cache(lambda: as_urdf(rigid(), check()))
    if branched(saved.mechanism):
        urdf = cache(lambda: _arms("calibrated.urdf", rigid(), saved, fresh()))
    own = np.random.default_rng([seed, 1])
    makers: tuple[dict[str, Callable[[str], Export]], ...] = (
        {
            "calibrated.urdf": lambda file: urdf(),
            **dict.fromkeys(DH, lambda file: _dh(file, rigid(), check())),
            **dict.fromkeys(OF_URDF, lambda file: of_urdf(file, rigid(), urdf())),
        },
        {
            "exports/model.py": lambda file: _numpy(file, check()),
            "exports/model.c": lambda file: _c(file, check()),
            "exports/model.h": lambda file: Export(file, HEADER, header_text(check().forward, _note(check().forward))),
        },
        {"exports/model.tex": lambda file: _latex(file, check())},
        {GRID: lambda file: _grid(file, lookup_grid(saved, place, box, nodes, own), nodes)},
    )
    return [partial(_made, saved, part) for part in makers]


def together(parts: Iterable[Exports]) -> Exports:
    """All parts as one."""
    every = tuple(parts)
    made = chain.from_iterable(part.made for part in every)
    return Exports(tuple(made), {file: why for part in every for file, why in part.refused.items()})


def _made(saved: SavedModel, makers: Mapping[str, Callable[[str], Export]]) -> Exports:
    """What of some files the model allows."""
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


def as_urdf(rigid: Rigid, check: Check) -> Export:
    """The refitted geometry as URDF, which ROS's and RoboDK's files are made of."""
    text = urdf_text(rigid, note_of(rigid))
    points = read_back(text, ".urdf", measured_link(text), rigid, check.dataset)
    return _geometry("calibrated.urdf", "as a URDF", text, check.errors(points), rigid)


def _dh(file: str, rigid: Rigid, check: Check) -> Export:
    mechanism = rigid.fit.model.mechanism
    text = dh_text(mechanism, chain_of(mechanism), rigid.twists, DH[file], note_of(rigid))
    errors = check.errors(read_back(text, ".toml", None, rigid, check.dataset))
    return _geometry(file, f"as {DH[file]} Denavit-Hartenberg rows", text, errors, rigid)


def of_urdf(file: str, rigid: Rigid, urdf: Export) -> Export:
    """One of OF_URDF of the refitted geometry and its URDF."""
    text, what = _beside(file, rigid, urdf.text)
    return _geometry(file, what, text, (urdf.rms, urdf.largest), rigid)


def _geometry(file: str, what: str, text: str, errors: tuple[float, float], rigid: Rigid) -> Export:
    """One of the forms of the same refitted geometry."""
    heldout = root_mean_square(rigid.heldout)
    return Export(file, f"the refitted geometry {what}", text, *errors, heldout, rigid.missing)


def _arms(file: str, rigid: Rigid, saved: SavedModel, dataset: Dataset) -> Export:
    """The refitted geometry of several arms."""
    kept = usable(saved)
    data = replace(dataset, observations=())
    points = observe(kept.model, prepare(saved.mechanism, data), kept.theta, kept.placement).tip[:, :3, 3]
    text = urdf_text(rigid, note_of(rigid))
    off = np.linalg.norm(read_back_arms(text, measured_link(text), rigid, data) - points, axis=1)
    return _geometry(file, "as a URDF", text, (root_mean_square(off), float(off.max())), rigid)


def _beside(file: str, rigid: Rigid, urdf: str) -> tuple[str, str]:
    """Text of a file of what a URDF text holds, and what it is."""
    mechanism, (nominal, link) = rigid.fit.model.mechanism, written(rigid.fit.model.mechanism, {})
    match file:
        case "exports/kinematics.yaml":
            return kinematics_text(urdf, note_of(rigid, measured_link(urdf))), "as origins of joints, for xacro"
        case "exports/joint_offsets.yaml":
            links = zip(link.split(","), measured_link(urdf).split(","), strict=True)
            note = note_of(rigid, link, {there: beyond(urdf, there, measured) for there, measured in links})
            return offsets_text(nominal, urdf, note), "as robot_calibration's offsets to the nominal URDF"
        case "exports/ur_kinematics.yaml":
            if branched(mechanism):
                raise InputError(f"{mechanism.name} has several arms; expected one, as in ur_description")
            last = last_ur_link(urdf)
            note = note_of(rigid, last, {last: beyond(urdf, last, measured_link(urdf))})
            return ur_text(nominal, urdf, note), "as the kinematics file of ur_description"
    note = note_of(rigid, "the last frame")
    return robodk_text(mechanism, chain_of(mechanism), rigid.twists, note), "as RoboDK's table"


def _numpy(file: str, check: Check) -> Export:
    text = numpy_text(check.forward, _note(check.forward))
    rms, largest = check.errors(_executed(check.forward, check))
    return Export(file, "the whole model as NumPy source", text, rms, largest, missing=check.forward.missing)


def _latex(file: str, check: Check) -> Export:
    rms, largest = check.errors(_executed(to_the_digits(check.forward), check))
    what = f"the terms as LaTeX, numbers to {DIGITS} digits, not held at the edges of their ranges"
    return Export(file, what, latex_text(check.forward), rms, largest, missing=check.forward.missing)


def _executed(forward: Forward, check: Check) -> Array:
    """Points (N, 3) that the NumPy source of a forward model predicts; without note and names of the table."""
    module = types.ModuleType("exported")
    exec(compile(numpy_text(nameless(forward), ""), "model.py", "exec"), module.__dict__)
    inputs = dict(zip(forward.inputs, check.inputs.T, strict=True))
    return np.asarray(module.predict(check.dataset.q, **inputs))


def _c(file: str, check: Check) -> Export:
    cases = np.hstack([check.dataset.q, check.inputs, check.points])[:CASES]
    text = c_text(check.forward, _note(check.forward), cases)
    found = tested(c_text(nameless(check.forward), "", cases))
    what = f"the whole model as C99, and its inverse; its own test compares it at {CASES} poses"
    return Export(file, what, text, found["RMS"], found["largest"], missing=check.forward.missing)


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
