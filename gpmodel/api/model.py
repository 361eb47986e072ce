"""Fitted error model of a mechanism: predict positions, compensate targets, export, verify."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd

from gpmodel.api.arguments import (
    MechanismLike,
    box_limits,
    brief,
    check_bool,
    check_choice,
    check_function,
    check_integer,
    check_number,
    check_text,
    file_path,
    mechanism_of,
)
from gpmodel.api.table import (
    Described,
    Shown,
    TableLike,
    aligned,
    announce_reading,
    dataset_of,
    frame_to_extend,
    with_numbers,
)
from gpmodel.application.compensate import compensated, of_frame, targets_in
from gpmodel.application.exports.programs import LANGUAGES, Language, program_text, rewritten_text
from gpmodel.application.model_file import SavedModel, model_content, save_model
from gpmodel.application.model_file import load_model as read_saved
from gpmodel.application.predict import beside, misses, predicted_columns
from gpmodel.application.usable import at_end, persists, session_effects, usable
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.progress import Say, silent
from gpmodel.report.saved import NAME, read_report
from gpmodel.report.schema import Report
from gpmodel.table.read import dataset_from
from gpmodel.table.robot_programs import is_program, read_program
from gpmodel.texts import SEAL
from gpmodel.wording import measured

if TYPE_CHECKING:
    from gpmodel.api.exports import ExportsResult
    from gpmodel.api.verification import VerifyResult

Point = Literal["tool", "frame"]
POINTS: tuple[Point, ...] = ("tool", "frame")

MODEL = "model.json"
"""File name of the model in a result folder."""


@dataclass(frozen=True, repr=False, eq=False)
class Model(Shown):
    """A mechanism with all effects that a calibration or a discovery fitted. saved: content of model.json, with the
    fitted values."""

    _with_rows = False
    saved: SavedModel

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism with its nominal geometry, to which the model adds effects."""
        return self.saved.mechanism

    def predict(
        self, poses: TableLike, *, as_measured: bool = False, session: bool = False, in_order: bool = False,
        progress: Say = silent,
    ) -> pd.DataFrame:  # fmt: skip
        """Predict the positions of the tool at given joint values.

        Returns `poses` with x, y, z [mm] in the instrument's frame; rx, ry, rz [deg] if rotations were fitted; the
        distances to known fixed points; `sigma [mm]`, the standard deviation of the point; and `outside`, the inputs
        beyond the ranges of the fit. A measured column x is kept, and the prediction is added as `predicted_x`; an
        earlier prediction is replaced.

        poses: joint values and the other columns that the model needs, as in a measured table.
        as_measured: include the fitted errors of the instrument, to predict its measurements.
        session: treat row k as row k of the fitted session. By default, effects that depend on the row or on time
        (`of_its_session`) keep the value of the end of the session.
        in_order: the poses are taken in the order of the rows, which backlash and hysteresis need.
        progress: function called with progress messages.
        A formula that is not in the catalogue is extrapolated by at most a tenth of an input's range, then held
        constant. Raises InputError if a column, a set-up or a tool does not fit the model.
        """
        return self.judged(poses, as_measured, session, in_order, progress)[0]

    def judged(
        self, poses: TableLike, as_measured: bool, session: bool, in_order: bool, progress: Say = silent
    ) -> tuple[pd.DataFrame, Array]:
        """Return predicted positions, as `predict` does, and their distances from measured points, as `misses` does."""
        check_function(progress, "progress")
        as_measured, session = check_bool(as_measured, "as_measured"), check_bool(session, "session")
        in_order = check_bool(in_order, "in_order")
        announce_reading(poses, progress)
        frame, text, path = frame_to_extend(poses, self.mechanism, "poses", self.saved.convention)
        dataset = (
            dataset_of(poses, self.mechanism, need_measurement=False, argument="poses")
            if text is frame and not is_program(poses)
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
        """Compute the joint values that bring the real tool to given targets.

        Returns `targets` with `corrected_J1 [deg]` and so on, the correction and the remaining error (residual) [mm],
        residual_turn [mrad], `sigma [mm]` of the reached point, and a status per row. Statuses with corrected values:
        `ok`; `near singular`, the position is reached but not all of the orientation; `outside the measured range`;
        `side of play open`, a joint with backlash arrives from another side than without correction. Statuses without
        corrected values: `large move`, `joint limit`, `not reached`.

        targets: joint values, whose nominal tool pose is the target; or x, y, z of the tool in the mechanism's root
        frame, with rx, ry, rz for a full pose.
        max_move: largest correction of a joint, deg.
        point: the point that is brought to x, y, z: "tool", the fitted tool point (reflector), or "frame", the origin
        of the measured link (flange). Correction and residual refer to the selected point.
        session, in_order: see `predict`.
        seed: random seed of the initial joint values for Cartesian targets.
        Raises InputError for a table without joint values or positions, or for targets that do not fit the model.
        """
        degrees = check_number(max_move, "max_move", 0.0, 360.0)
        if is_program(targets) and (program := read_program(Path(str(targets)))).corrected:
            raise InputError(f"{program.name}: its joint targets are corrected; expected the program before correction")
        session, in_order = check_bool(session, "session"), check_bool(in_order, "in_order")
        frame, text, path = frame_to_extend(targets, self.mechanism, "targets", self.saved.convention)
        rng = np.random.default_rng(check_integer(seed, "seed"))
        saved = at_end(usable(self.saved, session=session))
        saved = of_frame(saved) if check_choice(point, POINTS, "point") == "frame" else saved
        frame = frame if isinstance(targets, pd.DataFrame) else with_numbers(frame)
        return compensated(saved, frame, targets_in(saved, text, path, rng, in_order), float(np.radians(degrees)))

    def program(self, corrected: pd.DataFrame, language: Language, name: str = "compensated") -> str:
        """Write targets corrected by `compensate` as data of a robot program.

        A RAPID module has jointtargets and robtargets, a KRL data list E6AXIS and FRAME; j1 and p1 are the first row.
        Targets without corrected values are omitted and listed in a comment of the program.
        corrected: result of `compensate`. language: "RAPID" or "KRL". name: name of the module. Raises InputError for
        another frame, a mechanism with more than six joints, or if no row has corrected values.
        """
        if not isinstance(corrected, pd.DataFrame):
            raise InputError(f"{brief(corrected)}, expected the frame that compensate gives", "corrected")
        module = check_text(name, "name", "the name of a program")
        check_choice(language, LANGUAGES, "language")
        return program_text(self.mechanism, corrected, language, module, self.saved.convention)

    def rewrite(self, program: str | Path, corrected: pd.DataFrame) -> str:
        """Write targets corrected by `compensate` into the robot program that they were read from.

        Return the text of the program with the corrected joint values, in the controller's convention, and a comment
        that states the convention. All other text is kept, with the values of other external axes. Cartesian positions
        are not corrected; the comment states their number.
        program: file in KRL, RAPID, URScript or of Fanuc. corrected: result of `compensate` for this file. Raises
        InputError if a target has no corrected joint values, or the table is not that of the program.
        """
        source = read_program(file_path(program, "program"))
        return rewritten_text(source, self.mechanism, corrected, self.saved.convention)

    def export(
        self,
        *,
        box: Sequence[Sequence[float]] | str | None = None,
        nodes: int | None = None,
        setup: str | None = None,
        tool: str | None = None,
        seed: int = 0,
    ) -> "ExportsResult":
        """Export the model to files of other programs, and state each file's position error relative to `predict`.

        calibrated.urdf, Denavit-Hartenberg rows, ROS YAML files and RoboDK's table contain a geometry that is refitted
        without the effects that the file format cannot express. NumPy and C99 source contain the whole model, LaTeX its
        equations, and a grid file joint corrections.
        box: limits of the grid in the root frame, "800:1200,-200:200,300:700 mm", or lowest and highest x, y, z in m.
        The default box is the largest cube about a measured pose near the middle whose nodes are all reached and
        corrected.
        nodes: number of grid nodes along each side; None for 5.
        setup, tool: names of the registration and tool point for sources and grid, and, with several arms, of the arm;
        None for the first names.
        seed: random seed of the poses at which the errors of the files are evaluated.
        Raises InputError for an invalid or unreachable box, or an unknown name.
        """
        with extra_for("an export", "report"):
            from gpmodel.api.exports import ExportsResult
            from gpmodel.application.exports.grid import MOST_NODES, NODES
            from gpmodel.application.exports.make import GRID, exports_of
            from gpmodel.application.exports.sample import Place

        limits = None if box is None else box_limits(box, "box")
        setup = None if setup is None else check_text(setup, "setup", "the name of a set-up")
        tool = None if tool is None else check_text(tool, "tool", "the name of a tool")
        place = Place.of(self.saved, setup, tool)
        count = NODES if nodes is None else check_integer(nodes, "nodes", 2, MOST_NODES)
        made = exports_of(self.saved, place, box=limits, nodes=count, seed=check_integer(seed, "seed"))
        if box is not None and GRID in made.refused:
            raise InputError(made.refused[GRID], "box")
        return ExportsResult(self.mechanism.name, made)

    def verify(
        self, table: TableLike, *, tolerance: str | None = None, in_order: bool = False, **sights: Described
    ) -> "VerifyResult":
        """Test whether the model is still valid, by a table measured later.

        The function `gpmodel.verify` documents the arguments.
        """
        from gpmodel.api.verification import verify_saved  # imported late to keep `predict` fast
        from gpmodel.report.verification import VerifyRequest

        asked = VerifyRequest("gpmodel.verify", "model", self.sha256)
        return verify_saved(self.saved, table, asked, tolerance, check_bool(in_order, "in_order"), sights)

    def misses(
        self, poses: TableLike, *, as_measured: bool = False, session: bool = False, in_order: bool = False
    ) -> Array:
        """Return the distance between predicted and measured point, mm, for the rows of `poses` with x, y and z."""
        return self.judged(poses, as_measured, session, in_order)[1]

    def of_its_session(self, *, session: bool = False) -> tuple[str, ...]:
        """Return the names of effects that depend on row or time of the measurement session of the fit.

        session: include effects that end with the session: errors of the instrument, and drift of the set-up. With
        False, list only effects whose value at the end of the session remains valid.
        """
        return tuple(e.name for e in session_effects(self.saved) if session or persists(e))

    @property
    def sha256(self) -> str:
        """SHA-256 checksum of the model, as in model.json and the report; empty if a basis function has no text."""
        try:
            return str(model_content(self.saved)[SEAL])
        except InputError:
            return ""

    def save(self, file: str | Path, **more: object) -> None:
        """Write the model to a file model.json. more: additional JSON content, ignored on reading.

        Raises InputError if the file cannot be written, or a basis function is a Python function without text.
        """
        save_model(file_path(file, "file"), self.saved, **more)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per effect: name, family, value, standard error, unit, slot (frame), basis function."""
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
        """Return text with the mechanism, the nonzero effects, and the residual RMS of one coordinate."""
        kept = [
            (e.name, str(measured(value, deviation, e.unit, in_list=True)))
            for e, value, deviation in zip(self.saved.model.effects, self.saved.theta, self.saved.stderr, strict=True)
            if value != 0.0
        ]
        head = f"model of {self.mechanism.name}, {1e3 * self.saved.sigma:.4f} mm left in one coordinate"
        return "\n".join([head, aligned(kept)]) if kept else head

    def __eq__(self, other: object) -> bool:
        """Compare models by content; a model with a basis function without text equals only itself."""
        return self is other or (isinstance(other, Model) and self.sha256 == other.sha256 != "")

    def __hash__(self) -> int:
        return hash(self.sha256) if self.sha256 else id(self)

    def __repr__(self) -> str:
        kept = int(np.count_nonzero(self.saved.theta))
        return f"<model of {self.mechanism.name}: {kept} parameters and effects>"


def model_file(path: Path) -> Path:
    """Return the path of model.json in a result folder; a file is returned unchanged."""
    return path / MODEL if path.is_dir() else path


def load_model(file: str | Path, mechanism: MechanismLike | None = None) -> Model:
    """Load the model of `calibrate` or `discover` from its model.json or result folder.

    mechanism: needed if the mechanism was built in Python or its file was moved.
    Raises InputError if the file is missing, damaged, of another kind or version, or the mechanism has changed.
    """
    path = model_file(file_path(file, "file"))
    return Model(read_saved(path, None if mechanism is None else mechanism_of(mechanism)))


def read_result(after: Model | str | Path) -> tuple[Model, Report | None]:
    """Return a model and, from a result folder, the report of the model; raise InputError if no model is found."""
    if isinstance(after, Model):
        return after, None
    path = file_path(after, "after")
    folder = path if path.is_dir() else path.parent
    return load_model(path), read_report(folder) if (folder / NAME).is_file() else None
