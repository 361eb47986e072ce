"""A fitted model: what it predicts, and what makes the real mechanism go where it should."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gpmodel.api.arguments import whole
from gpmodel.api.display import aligned, notebook
from gpmodel.api.table import TableLike, dataset_of, frame_to_extend
from gpmodel.application.compensate import compensate_frame
from gpmodel.application.model_file import SavedModel, save_model
from gpmodel.application.model_file import load_model as read_saved
from gpmodel.application.predict import beside, misses, predicted_columns, reads_rows
from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.read import dataset_from
from gpmodel.wording import measured


@dataclass(frozen=True, repr=False)
class Model:
    """A mechanism with everything a calibration or a discovery fitted. saved: the numbers."""

    saved: SavedModel

    @property
    def mechanism(self) -> Mechanism:
        return self.saved.mechanism

    def predict(self, poses: TableLike) -> pd.DataFrame:
        """`poses` with what the instrument would read: x, y, z [mm] in its frame, rx, ry, rz [deg] where rotations
        were fitted, and the distances the model knows. A column that is there already is added as `predicted_x`.

        poses: joint values and the further columns the model reads, as in a measured table.
        Raises InputError where a column, a set-up or a tool does not fit the model.
        """
        frame, text, path = frame_to_extend(poses, self.mechanism)
        dataset = (
            dataset_of(poses, self.mechanism, need_measurement=False)
            if text is frame
            else dataset_from(text, path, self.mechanism, need_measurement=False)
        )
        return beside(frame, predicted_columns(self.saved, dataset))

    def compensate(self, targets: TableLike, *, seed: int = 0) -> pd.DataFrame:
        """`targets` with the joint values (`corrected_J1 [deg]`) that make the real tool reach them, the correction
        and what is left of it [mm], and a status a row; a row that is not ok has no joint values.

        targets: joint values, whose nominal tool pose is to be reached; or x, y, z of the tool in the mechanism's root
        frame, with rx, ry, rz for its whole pose. seed: of the starts from which Cartesian targets are solved.
        Raises InputError where they are neither, or do not fit the model.
        """
        frame, text, path = frame_to_extend(targets, self.mechanism)
        return compensate_frame(self.saved, frame, text, path, np.random.default_rng(whole(seed, "seed")))

    def misses(self, poses: TableLike) -> Array:
        """Distance (M,), mm, between prediction and measurement of the rows of `poses` that measured x, y and z."""
        dataset = dataset_of(poses, self.mechanism, need_measurement=False)
        return misses(dataset, predicted_columns(self.saved, dataset))

    @property
    def reads_rows(self) -> bool:
        """Whether any effect reads the row number, which means nothing in another session."""
        return reads_rows(self.saved)

    def save(self, file: str | Path, **more: Any) -> None:
        """Write model.json. Raises InputError: not writable, or a basis that has no text (a Python function)."""
        save_model(Path(file), self.saved, **more)

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
            (e.name, str(measured(value, deviation, e.unit)))
            for e, value, deviation in zip(self.saved.model.effects, self.saved.theta, self.saved.stderr, strict=True)
            if value != 0.0
        ]
        head = f"model of {self.mechanism.name}, {1e3 * self.saved.sigma:.4f} mm left in one coordinate"
        return "\n".join([head, aligned(kept)]) if kept else head

    def __repr__(self) -> str:
        kept = int(np.count_nonzero(self.saved.theta))
        return f"<model of {self.mechanism.name}: {kept} parameters and effects>"

    def _repr_html_(self) -> str:
        return notebook(self.summary())


def load_model(file: str | Path, mechanism: Mechanism | None = None) -> Model:
    """The model in a model.json of calibrate or discover.

    mechanism: the one it was made for, where it was built in Python and cannot be loaded by name.
    Raises InputError: missing, no JSON, of another kind or schema, incomplete, or its mechanism has changed.
    """
    return Model(read_saved(Path(file), mechanism))
