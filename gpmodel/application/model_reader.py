"""Read files with a checksum safely, and define model.json with bounds for every field.

A model may come from an untrusted source. Reading a model runs no code from it, opens no other file, and needs memory
and time in proportion to the file, which has at most 64 MiB.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Generic, Literal, TypeVar

import msgspec
import numpy as np

from gpmodel.arrays import Array
from gpmodel.characters import UNBROKEN
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, LARGEST
from gpmodel.mechanism.source import LONGEST_JOINT
from gpmodel.table.convention import LONGEST
from gpmodel.texts import SEAL, parse_json, read_limited, seal

KIND, SCHEMA = "gpmodel model", 3
"""Entries of model.json that state the kind of file and its schema version."""
SCHEMAS = (2, SCHEMA)
"""Schema versions of model.json that can be read. Before schema 3 the covariance was stored as a full matrix; in schema
3 a row ends at the diagonal."""
LARGEST_FILE = 64 << 20
"""Largest accepted model file, bytes: a hundred times a model of a humanoid with all families of effects."""
MOST_EFFECTS = 2000
"""Largest number of effects in a model file: ten times that of an arm with all families of effects."""
MOST_TERMS = 64
"""Largest number of sites of one effect in a model file. Effects of all masses act at every joint of a chain."""
MOST_COLUMNS = 500
"""Largest number of columns of a table in a model file, and of labels of one kind."""
MOST_UNKNOWNS = 5000
"""Largest number of unknowns of registration, tools and instruments in a model file. A ball bar's pose has five."""
MOST_ROWS = 1_000_000
"""Largest number of rows of a table in a model file: a hundred times the largest measured table."""
LARGEST_NUMBER = 1e13
"""Largest absolute value in a model file, SI. Lengths, stiffnesses and coordinates of machines are smaller, and so is a
time in milliseconds since 1970."""
CORRELATION_TOLERANCE = 1e-6
"""Largest accepted rounding error of a correlation outside [-1, 1]."""
ROTATION_TOLERANCE = 1e-6
"""Largest accepted deviation of a frame's axes from orthonormal, by rounding in the file."""

Finite = Annotated[float, msgspec.Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Deviation = Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST_NUMBER)]
Freedom = Annotated[float, msgspec.Meta(ge=1.0, le=LARGEST_NUMBER)]
Name = Annotated[str, msgspec.Meta(max_length=1000, pattern=UNBROKEN)]
Label = Annotated[str, msgspec.Meta(min_length=1, max_length=1000, pattern=UNBROKEN)]
Word = Annotated[str, msgspec.Meta(max_length=LONGEST_JOINT, pattern=r"^[^\W\d]\w*\Z")]
"""Type of a JSON text that is the name of a column, usable in an expression."""
Unit = Annotated[str, msgspec.Meta(max_length=50, pattern=r"^(?!.*\*/)[\w°%·*/^.() -]*\Z")]
FileName = Annotated[
    str, msgspec.Meta(min_length=1, max_length=200, pattern=r"^[^/\\\x00-\x1f\x7f\x85\u2028\u2029]+\Z")
]
Point = tuple[Finite, Finite, Finite]
Row = tuple[Finite, Finite, Finite, Finite]
Transform = tuple[Row, Row, Row, Row]
Formula = Annotated[str, msgspec.Meta(min_length=1, max_length=20_000, pattern=UNBROKEN)]
Columns = Annotated[dict[Word, Unit], msgspec.Meta(max_length=MOST_COLUMNS)]
Transforms = Annotated[dict[Name, Transform], msgspec.Meta(min_length=1, max_length=MOST_COLUMNS)]
Value = TypeVar("Value")
Rows = Annotated[tuple[Value, ...], msgspec.Meta(max_length=MOST_ROWS)]
Unknowns = Annotated[tuple[Finite, ...], msgspec.Meta(max_length=16)]


class TermPart(msgspec.Struct, frozen=True):
    """One term of an effect in model.json."""

    slot: Label
    axis: Label
    basis: Formula
    weight: Finite


class RigidPart(msgspec.Struct, frozen=True):
    """Rigid motion of a registration or a tool, m and rad, per unit of an effect."""

    of: Literal["setup", "tool"]
    label: Name
    twist: tuple[Finite, Finite, Finite, Finite, Finite, Finite]


class EffectPart(msgspec.Struct, frozen=True):
    """Effect and its fitted value in model.json. prior: prior standard deviation, null without prior. stderr: standard
    error, null if not fitted."""

    name: Label
    family: Name
    unit: Unit
    prior: Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST_NUMBER)] | None
    value: Finite
    stderr: Deviation | None
    terms: Annotated[tuple[TermPart, ...], msgspec.Meta(min_length=1, max_length=MOST_TERMS)]
    taken_up: Annotated[tuple[RigidPart, ...], msgspec.Meta(max_length=MOST_UNKNOWNS)] = ()


Weight = Annotated[float, msgspec.Meta(gt=0.0)]


class MechanismPart(msgspec.Struct, frozen=True):
    """Mechanism of the model in model.json.

    name: built-in name, or name of the file with the text `description`.
    tool_coms_m: centre of mass of the payload of each tool, m, if there are several tools.
    tip_at_probe_m: position of the measured link at one fixed set of joint values, m, which identifies the mechanism.
    """

    name: FileName
    frame: Label | None
    payload_kg: Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST_NUMBER)] | None
    payload_com_m: Point | None
    joints: Annotated[tuple[Word, ...], msgspec.Meta(min_length=1, max_length=200)]
    tip_at_probe_m: Point
    description: str | None = None
    gravity_m_s2: Point | None = None
    added_mass_kg: Finite | None = None
    added_moment_kg_m: Point | None = None
    tool_coms_m: Annotated[dict[Name, Point], msgspec.Meta(max_length=MOST_COLUMNS)] = {}


class MeasuredPart(msgspec.Struct, frozen=True):
    """Table that a model was fitted to, SI, one value or list of values per pose; null if not measured.

    counted_m: length, m, that counts as one pixel or radian, in files without `weights_m`.
    convention: formulas of the joints in the controller's axes, see `gpmodel.table.convention`; "" if not known.
    """

    file: Name
    sha256: Name
    row: Rows[int]
    heldout: Rows[Annotated[int, msgspec.Meta(ge=0)]]
    q: Rows[tuple[Finite, ...]]
    position_m: Rows[tuple[Finite | None, Finite | None, Finite | None]]
    rotation_rad: Rows[tuple[float | None, float | None, float | None]] | None
    distances_m: Annotated[dict[Label, Rows[float | None]], msgspec.Meta(max_length=MOST_COLUMNS)]
    payload_kg: Rows[float] | None
    labels: Annotated[dict[Label, Rows[Name]], msgspec.Meta(max_length=MOST_COLUMNS)]
    extras: Annotated[dict[Word, Rows[float | None]], msgspec.Meta(max_length=MOST_COLUMNS)]
    extra_units: Columns
    columns: Annotated[tuple[Name, ...], msgspec.Meta(max_length=MOST_COLUMNS)]
    in_order: bool
    readings: Annotated[dict[Word, Rows[float | None]], msgspec.Meta(max_length=MOST_COLUMNS)] = {}
    described: dict[Label, dict[str, object]] = {}
    counted_m: dict[Word, Weight] = {}
    convention: Annotated[str, msgspec.Meta(max_length=LONGEST, pattern=UNBROKEN)] = ""

    def __post_init__(self) -> None:
        given = {name: getattr(self, name) for name in ("q", "position_m", "rotation_rad", "payload_kg")}
        for kind in ("distances_m", "labels", "extras", "readings"):
            given |= {f"{kind}[{name!r}]": values for name, values in getattr(self, kind).items()}
        for name, values in given.items():
            if values is not None and len(values) != len(self.row):
                raise ValueError(f"expected {len(self.row)} values, one a row - at `$.measured.{name}`")
        if any(k >= len(self.row) for k in self.heldout):
            raise ValueError(f"expected places below {len(self.row)} - at `$.measured.heldout`")


class ModelPart(msgspec.Struct, frozen=True):
    """Content of model.json without its checksum; unknown keys are ignored.

    noise_m, discrepancy_m: null and zero in files of versions that did not estimate them.
    weights_m: length, m, that counts as one unit of each kind of measurement. lever_m: length, m, that counts as one
    radian of orientation, in files without `weights_m`.
    noise_shape: covariance of the coordinates of a position relative to their mean variance, with which the fit weighs
    them; null for equal weights.
    others, over_causes: effects that are alternative explanations of a finding, and the second moment of all unknowns
    over these alternatives; empty without alternatives.
    """

    kind: str
    schema: int
    mechanism: MechanismPart
    effects: Annotated[tuple[EffectPart, ...], msgspec.Meta(max_length=MOST_EFFECTS)]
    covariance: Annotated[tuple[tuple[Finite, ...], ...], msgspec.Meta(max_length=MOST_EFFECTS + MOST_UNKNOWNS)]
    unknowns: Annotated[tuple[Name, ...], msgspec.Meta(max_length=MOST_UNKNOWNS)]
    centre_m: Point
    ranges: Annotated[dict[Word, tuple[Finite, Finite]], msgspec.Meta(max_length=MOST_COLUMNS)]
    registration: Transforms
    tool: Transforms
    anchors_m: Annotated[dict[Name, Unknowns], msgspec.Meta(max_length=MOST_UNKNOWNS)]
    sigma_m: Deviation
    pose: bool
    input_units: Columns
    measured: MeasuredPart | None = None
    freedom: Freedom | None = None
    noise_m: Deviation | None = None
    discrepancy_m: Deviation = 0.0
    others: Annotated[tuple[EffectPart, ...], msgspec.Meta(max_length=MOST_EFFECTS)] = ()
    weights_m: Annotated[dict[Label, Weight], msgspec.Meta(max_length=MOST_COLUMNS)] = {}
    lever_m: Deviation | None = None
    noise_shape: tuple[Point, Point, Point] | None = None
    over_causes: Annotated[tuple[tuple[Finite, ...], ...], msgspec.Meta(max_length=2 * MOST_EFFECTS)] = ()

    def __post_init__(self) -> None:
        for label, transforms in (("registration", self.registration), ("tool", self.tool)):
            for name, rows in transforms.items():
                _check_rigid(np.array(rows), f"{label}[{name!r}]")
        for unknown in self.unknowns:
            words = unknown.split(" ")
            if len(words) < 2 or (words[0] in ("registration", "tool") and words[-1] not in AXES):
                raise ValueError(f"{unknown!r}, expected what and its axis, as in 'tool Tx' - at `$.unknowns`")
        size = len(self.effects) + len(self.unknowns)
        lengths = {2: [size] * size, SCHEMA: [*range(1, size + 1)]}
        if [len(row) for row in self.covariance] != lengths[self.schema]:
            raise ValueError(f"expected {size} rows, one an unknown, up to the diagonal - at `$.covariance`")
        _check_covariance(self.covariance)
        every = size + len(self.others) if self.over_causes or self.others else 0
        if [len(row) for row in self.over_causes] != [*range(1, every + 1)]:
            raise ValueError(f"expected {every} rows, one an unknown, up to the diagonal - at `$.over_causes`")
        _check_covariance(self.over_causes)
        shape = np.array(self.noise_shape or np.eye(3))
        if np.any(shape != shape.T) or np.linalg.matrix_rank(shape) < 3 or np.linalg.eigvalsh(shape)[0] <= 0.0:
            raise ValueError("expected a symmetric matrix of positive variances - at `$.noise_shape`")
        for name, rows in self.tool.items():
            for value in np.array(rows)[:3, 3]:
                if abs(value) > LARGEST["length"]:
                    raise ValueError(f"{value:g} m, expected at most {LARGEST['length']:g} m - at `$.tool[{name!r}]`")
        for name, (low, high) in self.ranges.items():
            if low > high:
                raise ValueError(f"expected the lower value first - at `$.ranges[{name!r}]`")


def _check_covariance(rows: Sequence[Sequence[float]]) -> None:
    """Raise ValueError for a negative variance, or a correlation outside [-1, 1] beyond rounding."""
    variances = np.array([row[k] for k, row in enumerate(rows)])
    if (variances < 0).any():
        raise ValueError("expected variances of zero or more - at `$.covariance`")
    for k, row in enumerate(rows):
        most = np.sqrt(variances[: len(row)] * variances[k])
        if (np.abs(row) > most * (1.0 + CORRELATION_TOLERANCE)).any():
            raise ValueError("expected correlations from -1 to 1 - at `$.covariance`")


def _check_rigid(transform: Array, where: str) -> None:
    turn = transform[:3, :3]
    whole = np.abs(turn @ turn.T - np.eye(3)).max() < ROTATION_TOLERANCE and np.linalg.det(turn) > 0.0
    if not whole or transform[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(f"no rotation and translation, expected orthonormal axes and 0 0 0 1 below - at `$.{where}`")


REPORT, REPORTED, REPORTED_FILE = "report.json", "model_sha256", "model.json"
"""File name of the report, its field with the checksum of the model, and file name of the model in the
report's folder."""
Part = TypeVar("Part")


@dataclass(frozen=True)
class Sealed(Generic[Part]):
    """Description of a kind of file with a checksum.

    kind, schemas: accepted entries of the file. part: structure of the content. word, expected: names for messages.
    """

    kind: str
    schemas: tuple[int, ...]
    part: type[Part]
    word: str
    expected: str


MODEL = Sealed(KIND, SCHEMAS, ModelPart, "model", "a model.json")


def read_part(path: Path) -> ModelPart:
    """Return the content of a model.json.

    Raises InputError for an unreadable file, or if report.json in the folder belongs to a different model. Files that
    are not named model.json, for example the true model of a simulation, need no report.
    """
    part, digest = read_sealed(path, MODEL)
    if path.name == REPORTED_FILE:
        _check_report(path, digest)
    return part


def read_sealed(path: Path, of: Sealed[Part]) -> tuple[Part, str]:
    """Read a JSON file with a checksum, and return content and checksum.

    Raises InputError for a missing, too large or changed file, invalid JSON, a kind or schema that `of` does not list,
    or an invalid field.
    """
    content = _content(path, of.expected)
    if not isinstance(content, dict) or content.get("kind") != of.kind:
        raise InputError(f"{path}: is no {of.word} of gpmodel; expected {of.expected}")
    if content.get("schema") not in of.schemas:
        read = " and ".join(map(str, of.schemas))
        raise InputError(f"{path}: schema {content.get('schema')!r}; this version of gpmodel reads schema {read}")
    try:
        part = converted(content, of.part, of.word)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if content.get(SEAL) != seal(content):
        raise InputError(f"{path}: the content was changed after writing (wrong {SEAL}); create the file again")
    return part, str(content[SEAL])


def converted(content: object, kind: type[Part], word: str) -> Part:
    """Convert the content of a JSON file to a record. Raises InputError naming a missing or invalid field; word: name
    of the content in messages."""
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        said, _, place = str(error).partition(" - at `$")
        place = place.partition("`")[0]
        said = said.replace(
            f"Expected `str` matching regex {UNBROKEN!r}", "Expected text without quotes, backslashes, line ends"
        )
        raise InputError(f"{place.lstrip('.') or word}: {said}") from None


def _check_report(path: Path, digest: str) -> None:
    try:
        report = parse_json(read_limited(path.parent / REPORT, LARGEST_FILE, "a report"))
    except ValueError:
        return
    said = report.get(REPORTED) if isinstance(report, dict) else None
    if said and said != digest:
        raise InputError(
            f"{path}: does not match {REPORT} in the same folder ({REPORTED} {str(said)[:12]}…); "
            "expected the model of this report"
        )


def _content(path: Path, expected: str) -> object:
    try:
        return parse_json(read_limited(path, LARGEST_FILE, expected))
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: is no JSON ({error}); expected {expected}") from None
