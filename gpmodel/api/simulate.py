"""Simulate measured tables with known errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.api.arguments import (
    NOISIEST,
    MechanismLike,
    brief,
    check_choice,
    check_integer,
    check_texts,
    errors_about,
    file_path,
    mechanism_of,
    to_si,
)
from gpmodel.api.model import Model
from gpmodel.api.table import Shown, TableLike, dataset_of
from gpmodel.application.model_file import SavedModel, unfitted
from gpmodel.application.model_reader import MOST_ROWS
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.files import write_text
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import LoadedMechanism, choice_of
from gpmodel.planning.simulate import INSTRUMENTS, NOISE, POOL, Simulation, random_tool_point, scene_of
from gpmodel.planning.simulate import simulate as measure
from gpmodel.table.cells import frame_of, joint_table, table_text
from gpmodel.table.dataset import LABELS, Dataset
from gpmodel.table.units import convert, identifier, known_unit, split_header
from gpmodel.texts import toml_text

Values = str | Sequence[float] | Array


@dataclass(frozen=True, repr=False)
class SimulationResult(Shown):
    """Simulated table and the true model, which predicts the table except for the noise."""

    table: Dataset
    truth: Model

    def to_dataframe(self) -> pd.DataFrame:
        """Return the simulated table, one row per pose, as text cells."""
        return frame_of(self.table, self.truth.mechanism)

    def summary(self) -> str:
        """Summarise the simulation: number of poses, mechanism and true effects."""
        return f"{len(self.table)} poses of {self.truth.mechanism.name}\n{self.truth.summary()}"

    def save(self, file: str | Path, **more: object) -> Path:
        """Write the table as .csv and the true model as .truth.json next to the table; return the path of the model.

        Cameras and boards are described in .cameras.toml and .board.toml.
        more: additional JSON content of the model's file, not read back.
        Raises InputError if a file cannot be written.
        """
        path = file_path(file, "file")
        write_text(path, table_text(self.to_dataframe()))
        for name, content in self.table.described.items():
            write_text(path.with_suffix(f".{name}.toml"), toml_text(content))
        self.truth.save(path.with_suffix(".truth.json"), **more)
        return path.with_suffix(".truth.json")

    def __repr__(self) -> str:
        return f"<{len(self.table)} simulated poses of {self.truth.mechanism.name}>"


def simulate(
    mechanism: MechanismLike,
    effects: Sequence[str] = (),
    *,
    poses: int | TableLike = 90,
    noise: str | float | None = None,
    instrument: str = "tracker",
    geometry_sigma: str | float = 0.0,
    inputs: Mapping[str, Values] | None = None,
    seed: int = 0,
) -> SimulationResult:
    """Simulate measurements of a mechanism with known errors, with random instrument position and tool point.

    effects: "gear_harmonic J4=20 arcsec" or "slot:axis:expression=value".
    poses: number of random poses within the limits, or a table of joint values.
    noise: standard deviation of one measured value (for a tracker: of x, y and z), text with a unit; None for 0.03 mm,
    0.1 px or 0.002 deg.
    instrument: "tracker", or an instrument that measures no points: "camera", "hand camera", "planes", "spheres",
    "points", "bar" or "inclinometer".
    geometry_sigma: standard deviation of every constant error: x means x m for lengths and x rad for angles.
    inputs: further columns by header with unit, "temperature [degC]": "20:30" (uniform), "20|30" (one of the values in
    each row) or values. A column `payload [kg]`, or the mechanism's payload, acts at the tool point.
    seed: random seed of the simulation.
    Raises InputError for an invalid argument.
    """
    dimension, usual = NOISE.get(check_choice(instrument, INSTRUMENTS, "instrument"), ("length", "0.03 mm"))
    spread = to_si(usual if noise is None else noise, dimension, "noise", most=NOISIEST)
    sigma = to_si(geometry_sigma, "length", "geometry_sigma", most=NOISIEST)
    rng = np.random.default_rng(check_integer(seed, "seed"))
    arm = mechanism_of(mechanism)
    planted = check_texts(effects, "effects", "['gear_harmonic J4=20 arcsec']")
    given = None if isinstance(poses, int) else dataset_of(poses, arm, need_measurement=False, argument="poses")
    count = len(given) if given is not None else check_integer(poses, "poses", 1, MOST_ROWS)
    if not isinstance(inputs, Mapping | None):
        raise InputError(f"{brief(inputs)}, expected columns, as in {{'temperature [degC]': '20:30'}}", "inputs")
    columns = [_column(header, values, count, rng) for header, values in (inputs or {}).items()]
    payload = next((values for name, _, values in columns if name == "payload"), None)
    carried = choice_of(arm).payload
    if payload is None and carried is not None:
        payload = np.full(count, carried)
    tool_point = random_tool_point(rng)
    if payload is not None and isinstance(arm, LoadedMechanism) and arm.choice.payload_com is None:
        arm = arm.carrying_at(tool_point)
    scene = None
    if instrument != "tracker":
        if given is not None:
            raise InputError(f"the simulation of {instrument} draws the poses; expected the number of poses", "poses")
        scene = scene_of(instrument, arm, random_poses(arm, POOL * count, rng), count, tool_point, rng)
    q = scene.q if scene else random_poses(arm, count, rng) if given is None else given.q
    _check_columns(columns, q, arm)
    with errors_about("effects"):
        made = measure(
            arm, q, planted, rng, scene=scene,
            noise=spread, geometry_sigma=sigma, payload=payload,
            inputs={n: v for n, _, v in columns if n != "payload"},
            input_units={n: u for n, u, _ in columns if n != "payload"},
            tool_point=tool_point, drawn=given is None,
        )  # fmt: skip
    return SimulationResult(made.dataset, Model(_truth(made)))


def _check_columns(columns: Sequence[tuple[str, str, Array]], q: Array, arm: Mechanism) -> None:
    """Raise InputError for columns that a measured table could not contain as inputs."""
    inputs = pd.DataFrame(dict(enumerate(values for *_, values in columns)), index=range(len(q)))
    inputs.columns = pd.Index([f"{name} [{unit}]" for name, unit, _ in columns])
    with errors_about("inputs"):
        read = dataset_of(pd.concat([joint_table(arm, q), inputs], axis=1), arm, need_measurement=False)
        measured = [name for name, *_ in columns if name not in (*read.extra_units, *LABELS, "payload")]
        if measured:
            raise InputError(f"'{measured[0]}' is the name of a measured column, expected another name")


def _truth(made: Simulation) -> SavedModel:
    count = len(made.theta)
    return SavedModel(
        model=made.model,
        theta=made.theta,
        stderr=np.full(count, np.nan),
        covariance=unfitted(count),
        placement=made.placement,
        weights={},
        sigma=made.noise,
        pose=False,
        input_units=dict(made.dataset.extra_units),
    )


def _column(header: str, values: Values, count: int, rng: np.random.Generator) -> tuple[str, str, Array]:
    """Return name, unit and values of an input column from its header and its description such as "20:30"."""
    name, unit = split_header(str(header))
    if not name or unit is None or not known_unit(unit):
        raise InputError(f"'{header}', expected a name with its unit, as in 'temperature [degC]'", "inputs")
    name = identifier(name)
    if isinstance(values, str):
        if ":" in values:
            low, high = (convert(v, unit, "inputs") for v in values.split(":", 1))
            if low > high:
                raise InputError(f"'{values}', expected the smaller value first, as in 20:30", "inputs")
            return name, unit, rng.uniform(low, high, count)
        return name, unit, rng.choice([convert(v, unit, "inputs") for v in values.split("|")], count)
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise InputError(f"'{header}': expected {count} finite values, one a pose", "inputs")
    return name, unit, array
