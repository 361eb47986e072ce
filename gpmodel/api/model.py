"""A fitted model: what it predicts, and what makes the real mechanism go where it should."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd

from gpmodel.api.arguments import (
    MechanismLike,
    among,
    box_limits,
    called,
    file_path,
    mechanism_of,
    number,
    shown,
    switch,
    text,
    whole,
)
from gpmodel.api.table import (
    Described,
    Shown,
    TableLike,
    aligned,
    dataset_of,
    frame_to_extend,
    told_of_reading,
    with_numbers,
)
from gpmodel.application.compensate import compensated, of_frame, targets_in
from gpmodel.application.exports.programs import LANGUAGES, Language, program_text
from gpmodel.application.model_file import SavedModel, model_content, save_model
from gpmodel.application.model_file import load_model as read_saved
from gpmodel.application.predict import beside, misses, predicted_columns
from gpmodel.application.usable import lasting, of_the_session, placed_now, usable
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.progress import Say, silent
from gpmodel.report.saved import NAME, read_report
from gpmodel.report.schema import Report
from gpmodel.table.read import dataset_from
from gpmodel.texts import SEAL
from gpmodel.wording import measured

if TYPE_CHECKING:
    from gpmodel.api.exports import ExportsResult
    from gpmodel.api.verification import VerifyResult

Point = Literal["tool", "frame"]
POINTS: tuple[Point, ...] = ("tool", "frame")

MODEL = "model.json"
"""File name of the model in the folder of a result."""


@dataclass(frozen=True, repr=False, eq=False)
class Model(Shown):
    """A mechanism with everything a calibration or a discovery fitted. saved: the numbers."""

    _with_rows = False
    saved: SavedModel

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that the model corrects."""
        return self.saved.mechanism

    def predict(
        self, poses: TableLike, *, as_measured: bool = False, session: bool = False, in_order: bool = False,
        progress: Say = silent,
    ) -> pd.DataFrame:  # fmt: skip
        """`poses` with where the tool is now: x, y, z [mm] in the instrument's frame, rx, ry, rz [deg] where rotations
        were fitted, and the distances the model knows; `sigma [mm]`, the standard deviation of that point, and the
        inputs that lie `outside` the ranges the model was fitted in. A column that is there already is added as
        `predicted_x`; columns of an earlier prediction are replaced.

        poses: joint values and the further columns the model reads, as in a measured table. Now is the end of the
        session the model was fitted to, where effects that read its rows or time (`of_its_session`) have left it; the
        errors of the instrument that were found are left out. as_measured: with these, what the instrument would read.
        session: the rows are those of the session itself, as measured. in_order: the rows are in the order in which the
        poses are taken, which play and hysteresis ask for. progress: called with what is being done. Beyond its ranges,
        by more than a twentieth of their width, a law without a name keeps its value. Raises InputError where a
        column, a set-up or a tool does not fit the model.
        """
        return self.judged(poses, as_measured, session, in_order, progress)[0]

    def judged(
        self, poses: TableLike, as_measured: bool, session: bool, in_order: bool, progress: Say = silent
    ) -> tuple[pd.DataFrame, Array]:
        """Return the results of `predict` and `misses` at the cost of one of them."""
        called(progress, "progress")
        as_measured, session = switch(as_measured, "as_measured"), switch(session, "session")
        in_order = switch(in_order, "in_order")
        told_of_reading(poses, progress)
        frame, text, path = frame_to_extend(poses, self.mechanism, "poses")
        dataset = (
            dataset_of(poses, self.mechanism, need_measurement=False, argument="poses")
            if text is frame
            else dataset_from(text, path, self.mechanism, need_measurement=False)
        )
        dataset = replace(dataset, in_order=in_order or dataset.in_order)
        used = usable(self.saved, session=session, as_measured=as_measured)
        kept = frame if isinstance(poses, pd.DataFrame) else with_numbers(frame)
        columns = predicted_columns(used, dataset, progress)
        return beside(kept, columns), misses(dataset, columns)

    def compensate(
        self,
        targets: TableLike,
        *,
        max_move: float = 2.0,
        point: Point = "tool",
        session: bool = False,
        in_order: bool = False,
        seed: int = 0,
    ) -> pd.DataFrame:
        """`targets` with the joint values (`corrected_J1 [deg]`) that make the real tool reach them, the correction
        and its residual [mm] and residual_turn [mrad], `sigma [mm]` of the reached point, and a status a row: `ok`;
        `near singular`, the position is reached and not all of the orientation; `outside the measured range`; `side of
        play open`, a joint with play comes from another side than without correction; and without joint values `large
        move`, `joint limit`, `not reached`.

        targets: joint values, whose nominal tool pose is to be reached; or x, y, z of the tool in the mechanism's root
        frame, with rx, ry, rz for its whole pose. max_move: degrees that no joint may be moved by more. point: that is
        to be at x, y, z, and whose correction and rest are stated: "tool", the measured point (the reflector) where the
        fit found it, slips included, or "frame", the origin of the measured link (the flange). session and in_order: as
        in `predict`. seed: of the starts from which Cartesian targets are solved.
        Raises InputError where they are neither, or do not fit the model.
        """
        degrees = number(max_move, "max_move", 0.0, 360.0)
        session, in_order = switch(session, "session"), switch(in_order, "in_order")
        frame, text, path = frame_to_extend(targets, self.mechanism, "targets")
        saved, rng = placed_now(usable(self.saved, session=session)), np.random.default_rng(whole(seed, "seed"))
        saved = of_frame(saved) if among(point, POINTS, "point") == "frame" else saved
        frame = frame if isinstance(targets, pd.DataFrame) else with_numbers(frame)
        return compensated(saved, frame, targets_in(saved, text, path, rng, in_order), float(np.radians(degrees)))

    def program(self, corrected: pd.DataFrame, language: Language, name: str = "compensated") -> str:
        """The targets that `compensate` corrected as data of a robot program: a RAPID module of jointtargets and
        robtargets, or a KRL data list of E6AXIS and FRAME, j1 and p1 of the first row. Rows without corrected values
        are left out and named in a comment.

        corrected: what `compensate` gave. language: "RAPID" or "KRL". name: of the module. Raises InputError for
        another frame, a mechanism of more than six joints, or where no row has corrected values.
        """
        if not isinstance(corrected, pd.DataFrame):
            raise InputError(f"{shown(corrected)}, expected the frame that compensate gives", "corrected")
        module = text(name, "name", "the name of a program")
        return program_text(self.mechanism, corrected, among(language, LANGUAGES, "language"), module)

    def export(
        self,
        *,
        box: Sequence[Sequence[float]] | str | None = None,
        nodes: int | None = None,
        setup: str | None = None,
        tool: str | None = None,
        seed: int = 0,
    ) -> "ExportsResult":
        """The model in the forms that others read, each with its error against `predict`: a geometry refitted without
        what it cannot hold as calibrated.urdf, Denavit-Hartenberg rows, ROS's YAML files and RoboDK's table; the whole
        model as NumPy and C99 source, its terms as LaTeX, and a lookup grid of joint corrections.

        box: of the grid in the root frame, "800:1200,-200:200,300:700 mm" or lowest and highest x, y, z in m; without
        one the largest cube about a measured pose near the middle that is reached and corrected everywhere. nodes: of
        the grid along each side; 5 for None. setup, tool: whose registration and tool point the sources and the grid
        have, where the model knows several, and of two arms the tool's; the first for None. seed: of the fresh poses
        the errors are judged at.
        Raises InputError for a box that is none, or of which nothing is reached, or a name the model does not know.
        """
        with extra_for("an export", "report"):
            from gpmodel.api.exports import ExportsResult
            from gpmodel.application.exports.grid import MOST_NODES, NODES
            from gpmodel.application.exports.make import GRID, exports_of
            from gpmodel.application.exports.sample import Place

        limits = None if box is None else box_limits(box, "box")
        setup = None if setup is None else text(setup, "setup", "the name of a set-up")
        tool = None if tool is None else text(tool, "tool", "the name of a tool")
        place = Place.of(self.saved, setup, tool)
        count = NODES if nodes is None else whole(nodes, "nodes", 2, MOST_NODES)
        made = exports_of(self.saved, place, box=limits, nodes=count, seed=whole(seed, "seed"))
        if box is not None and GRID in made.refused:
            raise InputError(made.refused[GRID], "box")
        return ExportsResult(self.mechanism.name, made)

    def verify(
        self, table: TableLike, *, tolerance: str | None = None, in_order: bool = False, **sights: Described
    ) -> "VerifyResult":
        """Test whether the model still holds, from a table measured later.

        See `gpmodel.verify`, which also has `cameras`, `board` and `surfaces`.
        """
        from gpmodel.api.verification import verify_saved  # which `predict` need not wait for
        from gpmodel.report.verification import VerifyRequest

        asked = VerifyRequest("gpmodel.verify", "model", self.sha256)
        return verify_saved(self.saved, table, asked, tolerance, switch(in_order, "in_order"), sights)

    def misses(
        self, poses: TableLike, *, as_measured: bool = False, session: bool = False, in_order: bool = False
    ) -> Array:
        """Distance (M,), mm, between prediction and measurement of the rows of `poses` that measured x, y and z."""
        return self.judged(poses, as_measured, session, in_order)[1]

    def of_its_session(self, *, session: bool = False) -> tuple[str, ...]:
        """Effects that read the rows or the time of the session they were fitted to: its end is now. session: as well
        those that are over with it, of the instrument and of a set-up that wandered."""
        return tuple(e.name for e in of_the_session(self.saved) if session or lasting(e))

    @property
    def sha256(self) -> str:
        """The seal of its content, as in model.json and the report; empty where a basis has no text."""
        try:
            return str(model_content(self.saved)[SEAL])
        except InputError:
            return ""

    def save(self, file: str | Path, **more: object) -> None:
        """Write model.json. more: kept with it, as JSON, and ignored when it is read.

        Raises InputError: not writable, or a basis that has no text (a Python function).
        """
        save_model(file_path(file, "file"), self.saved, **more)

    def to_dataframe(self) -> pd.DataFrame:
        """One row an effect: name, family, value, stderr, unit, slot, basis."""
        saved = self.saved
        return pd.DataFrame(
            {
                "name": [e.name for e in saved.model.effects],
                "family": [e.family for e in saved.model.effects],
                "value": saved.theta,
                "stderr": saved.stderr,
                "unit": [e.unit for e in saved.model.effects],
                "slot": [", ".join(e.slots) for e in saved.model.effects],
                "basis": ["; ".join(dict.fromkeys(str(t.basis) for t in e.terms)) for e in saved.model.effects],
            }
        )

    def summary(self) -> str:
        """Mechanism, effects that are not zero, and the noise of one component."""
        kept = [
            (e.name, str(measured(value, deviation, e.unit, in_list=True)))
            for e, value, deviation in zip(self.saved.model.effects, self.saved.theta, self.saved.stderr, strict=True)
            if value != 0.0
        ]
        head = f"model of {self.mechanism.name}, {1e3 * self.saved.sigma:.4f} mm left in one coordinate"
        return "\n".join([head, aligned(kept)]) if kept else head

    def __eq__(self, other: object) -> bool:
        """Compare models by content; a model without text equals only itself."""
        return self is other or (isinstance(other, Model) and self.sha256 == other.sha256 != "")

    def __hash__(self) -> int:
        return hash(self.sha256) if self.sha256 else id(self)

    def __repr__(self) -> str:
        kept = int(np.count_nonzero(self.saved.theta))
        return f"<model of {self.mechanism.name}: {kept} parameters and effects>"


def model_file(path: Path) -> Path:
    """The model of a folder of results, or the file itself."""
    return path / MODEL if path.is_dir() else path


def load_model(file: str | Path, mechanism: MechanismLike | None = None) -> Model:
    """The model in a model.json of calibrate or discover, or in the folder that has it.

    mechanism: the one it was made for, where it was built in Python, or was moved and is not found by its name.
    Raises InputError: missing, no JSON, of another kind or schema, incomplete, or its mechanism has changed.
    """
    path = model_file(file_path(file, "file"))
    return Model(read_saved(path, None if mechanism is None else mechanism_of(mechanism)))


def read_result(after: Model | str | Path) -> tuple[Model, Report | None]:
    """A model and, where it lies in a folder of discover or calibrate, its report. Raises InputError for neither."""
    if isinstance(after, Model):
        return after, None
    path = file_path(after, "after")
    folder = path if path.is_dir() else path.parent
    return load_model(path), read_report(folder) if (folder / NAME).is_file() else None
