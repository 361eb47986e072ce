"""Write and read model.json: a fitted model for prediction and compensation, and the table it was fitted to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gpmodel._version import __version__
from gpmodel.application.model_reader import KIND, SCHEMA, EffectPart, MeasuredPart, ModelPart, converted, read_part
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.result import Calibration, Covariance
from gpmodel.characters import harmless
from gpmodel.errors import InputError, choices
from gpmodel.files import plain, to_json, write_text
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import same_machine, tip_at_trial
from gpmodel.mechanism.protocol import Mechanism, places
from gpmodel.mechanism.source import MechanismChoice, choice_of
from gpmodel.model.effect import Effect, TakenUp, Term
from gpmodel.model.error_model import ErrorModel, Placement, Poses
from gpmodel.model.inclination import Inclination
from gpmodel.model.instruments import with_observations
from gpmodel.model.memory import clock_of, read_by
from gpmodel.model.observation import Orientation, Weights
from gpmodel.model.pixel import Pixels
from gpmodel.model.sites import table_names
from gpmodel.model.states import measured_torques
from gpmodel.model.touches import Touches
from gpmodel.table.convention import Convention, read_convention
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import identifier
from gpmodel.texts import SEAL, parse_json, seal


@dataclass(frozen=True)
class Measured:
    """A measured table, and the numbers of the rows that were held out from the selection of effects."""

    dataset: Dataset
    heldout: IntArray


def measured_record(measured: Measured | None) -> dict[str, object] | None:
    """Return the measured table as JSON, SI; None without a table, or with measurements that a file cannot hold."""
    if measured is None or not all(
        isinstance(o, Touches | Pixels | Inclination) for o in measured.dataset.observations
    ):
        return None
    data = measured.dataset
    return {
        "file": Path(data.source).name,
        "sha256": data.sha256,
        "row": data.row,
        "heldout": measured.heldout,
        "q": data.q,
        "position_m": data.position,
        "rotation_rad": data.rotation if data.has_rotation else None,
        "distances_m": dict(data.distances),
        "payload_kg": data.payload if data.payload_given else None,
        "labels": {name: values.tolist() for name, values in data.labels.items()},
        "extras": dict(data.extras),
        "extra_units": dict(data.extra_units),
        "columns": data.columns,
        "in_order": data.in_order,
        "readings": dict(data.readings),
        "described": dict(data.described),
        "convention": data.convention,
    }


def measured_from(record: MeasuredPart, mechanism: Mechanism) -> Measured:
    """Read a measured table from its JSON record. Raises InputError if the joints of the record are not those of the
    mechanism."""
    joints = mechanism.joints
    count = len(record.row)
    if {len(row) for row in record.q} - {len(joints)}:
        raise InputError(f"measured.q: expected {len(joints)} values a row, those of the joints")
    known = [{joint.name, f"J{i}"} for i, joint in enumerate(joints, 1)]
    words = [identifier(column) for column in record.columns]
    if record.columns and (len(words) != len(joints) or any(w not in of for w, of in zip(words, known, strict=True))):
        raise InputError(f"measured.columns: expected the {len(joints)} joints, by their names or as J1, J2, ...")
    rotation, payload = record.rotation_rad, record.payload_kg
    dataset = Dataset(
        joints=tuple(joint.name for joint in joints),
        kinds=tuple(joint.kind for joint in joints),
        q=_numbers(record.q).reshape(count, len(joints)),
        position=_numbers(record.position_m).reshape(count, 3),
        rotation=np.full((count, 3), np.nan) if rotation is None else _numbers(rotation).reshape(count, 3),
        row=np.array(record.row, dtype=np.int64),
        payload=np.zeros(count) if payload is None else _numbers(payload),
        distances={name: _numbers(values) for name, values in record.distances_m.items()},
        labels={name: np.array(values, dtype=str) for name, values in record.labels.items()},
        extras={name: _numbers(values) for name, values in record.extras.items()},
        extra_units=record.extra_units,
        payload_given=payload is not None,
        source=record.file,
        sha256=record.sha256,
        columns=record.columns,
        joints_approximate=not all(joint.measured for joint in joints),
        in_order=record.in_order,
        readings={name: _numbers(values) for name, values in record.readings.items()},
        described=record.described,
        convention=record.convention and read_convention(record.convention, mechanism, "measured.convention").text,
    )
    dataset = with_observations(dataset, mechanism)
    return Measured(dataset, np.array(record.heldout, dtype=np.int64))


def _earlier_weights(part: ModelPart) -> Weights:
    """Return the weights of kinds of measurements from an older model.json without the entry `weights_m`."""
    lever = {} if part.lever_m is None else {Orientation.name: part.lever_m}
    return lever if part.measured is None else {**lever, **part.measured.counted_m}


def _numbers(values: Sequence[object]) -> Array:
    """Return JSON numbers as an array, with NaN for null."""
    return np.array(values, dtype=float)


@dataclass(frozen=True)
class SavedModel:
    """Fitted model as saved in model.json.

    theta, stderr: values and standard errors of the effects in SI units, stderr NaN where not fitted. covariance:
    covariance of registration, tool and effects.
    weights: length, m, that counts as one unit of each kind of measurement.
    noise_shape: covariance of the coordinates of a position that weighs them in the fit; None for equal weights.
    sigma: residual standard deviation of one component, m. freedom: degrees of
    freedom of sigma, infinite if not estimated. pose: True if rotations were measured.
    input_units: units of the extra columns that the effects need.
    ranges: lowest and highest fitted value of joints and input columns, SI or the table's unit.
    measured: the fitted table, None if not saved.
    noise, discrepancy: standard deviation of one component, m, of the instrument and of the model discrepancy (see
    `application.further`); Noise is None and discrepancy zero if not estimated.
    """

    model: ErrorModel
    theta: Array
    stderr: Array
    covariance: Covariance
    placement: Placement
    weights: Weights
    sigma: float
    pose: bool
    input_units: Mapping[str, str]
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    measured: Measured | None = None
    freedom: float = np.inf
    noise: float | None = None
    discrepancy: float = 0.0
    noise_shape: Array | None = None

    @property
    def lever(self) -> float:
        """Distance, m, of the model's farthest tool point from the flange."""
        return max((float(np.linalg.norm(frame[:3, 3])) for frame in self.placement.tool.values()), default=0.0)

    @property
    def spread(self) -> float:
        """Standard deviation, m, of one measured coordinate about the model with its true parameters."""
        return max(self.sigma, float(np.hypot(self.noise or 0.0, self.discrepancy)))

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism whose errors the model describes."""
        return self.model.mechanism

    @property
    def columns(self) -> tuple[str, ...]:
        """Joint names in the fitted table; without a table, the mechanism's names."""
        named = self.measured.dataset.columns if self.measured is not None else ()
        return named or tuple(joint.name for joint in self.mechanism.joints)

    @property
    def convention(self) -> Convention | None:
        """Convention of the controller's joint values, None if not known."""
        text = self.measured.dataset.convention if self.measured is not None else ""
        return read_convention(text, self.mechanism, "convention") if text else None

    @property
    def names(self) -> Mapping[str, str]:
        """Map from the mechanism's names of joints, and of inputs with joint names, to names in the table."""
        return table_names([joint.name for joint in self.mechanism.joints], self.columns)


def saved_model(fit: Calibration, poses: Poses, heldout: IntArray | None = None) -> SavedModel:
    """Reduce a calibration on `poses` to a model for a file. heldout: numbers of rows that selection did not use."""
    dataset = poses.dataset
    read = needed(fit.model, dataset)
    columns = {*dataset.joints, *(name for effect in fit.model.effects for name in effect.inputs)}
    return SavedModel(
        model=fit.model,
        theta=fit.theta,
        stderr=fit.stderr,
        covariance=fit.covariance,
        placement=fit.placement,
        weights=fit.weights,
        sigma=fit.sigma,
        pose=dataset.has_rotation,
        input_units={k: v for k, v in dataset.extra_units.items() if k in read},
        ranges={c: (float(poses.states[c].min()), float(poses.states[c].max())) for c in sorted(columns)},
        measured=Measured(dataset, np.zeros(0, dtype=np.int64) if heldout is None else heldout),
        freedom=fit.freedom,
        noise_shape=fit.noise_shape,
    )


def unfitted(effects: int) -> Covariance:
    """Return the covariance of a model without fitted values, such as the true model of a simulation."""
    return Covariance(np.zeros((effects, effects)), (), np.zeros(3))


def needed(model: ErrorModel, dataset: Dataset) -> set[str]:
    """Return the names of the columns that a model's effects need, directly, through earlier rows, or as measured
    torques."""
    direct = {name for effect in model.effects for name in effect.inputs}
    remembered = {source for name in direct - set(dataset.extras) for source in read_by(name)}
    clock = clock_of(dataset) if any(name.startswith("lag_") for name in direct) else None
    measured = measured_torques(model.mechanism, dataset)
    torques = {column for joint, column in measured.items() if f"torque_{joint}" in direct | remembered}
    return direct | remembered | torques | ({clock} if clock else set())


def _unknowns(key: str, values: Sequence[float]) -> Array:
    """Return the unknowns of an instrument; the zero offset of a distance, which older files lack, is added."""
    if key.startswith("distance_") and len(values) not in (3, 4):
        raise InputError(f"anchors_m: {key} has {len(values)} numbers; expected x, y, z and the zero")
    return np.array((*values, 0.0) if key.startswith("distance_") and len(values) == 3 else values)


def model_content(saved: SavedModel, **more: object) -> dict[str, object]:
    """Return the content of model.json with its checksum. more: additional JSON content, not read back.

    Raises InputError for a basis function whose text is not an expression: a function in Python cannot be saved.
    """
    mechanism = saved.mechanism
    choice = choice_of(mechanism)
    for effect in saved.model.effects:
        for term in effect.terms:
            Expression(str(term.basis))
    content: dict[str, object] = {
        "kind": KIND,
        "schema": SCHEMA,
        "version": __version__,
        "mechanism": {
            "name": harmless(Path(choice.name).name),
            "frame": choice.frame,
            "payload_kg": choice.payload,
            "payload_com_m": choice.payload_com,
            "tool_coms_m": dict(choice.tool_coms),
            "gravity_m_s2": choice.gravity,
            "added_mass_kg": choice.added_mass,
            "added_moment_kg_m": choice.added_moment,
            "joints": [j.name for j in mechanism.joints],
            "tip_at_probe_m": tip_at_trial(mechanism),
            "description": choice.description,
        },
        "effects": [
            _effect_content(effect, value, stderr)
            for effect, value, stderr in zip(saved.model.effects, saved.theta, saved.stderr, strict=True)
        ],
        "covariance": [row[: k + 1] for k, row in enumerate(saved.covariance.values)],
        "unknowns": saved.covariance.placement,
        "centre_m": saved.covariance.centre,
        "others": [_effect_content(effect, 0.0, np.nan) for effect in saved.covariance.alternatives],
        "over_causes": [row[: k + 1] for k, row in enumerate(saved.covariance.over_causes)],
        "ranges": {name: list(limits) for name, limits in saved.ranges.items()},
        "registration": dict(saved.placement.registration),
        "tool": dict(saved.placement.tool),
        "anchors_m": dict(saved.placement.anchors),
        "weights_m": dict(saved.weights),
        "noise_shape": saved.noise_shape,
        "sigma_m": saved.sigma,
        "noise_m": saved.noise,
        "discrepancy_m": saved.discrepancy,
        "freedom": saved.freedom,
        "pose": saved.pose,
        "input_units": dict(saved.input_units),
        "measured": measured_record(saved.measured),
        **more,
    }
    return content | {SEAL: seal(content)}


def model_text(saved: SavedModel, **more: object) -> str:
    """Return the text of model.json. Raises InputError for a basis function without text."""
    return to_json(model_content(saved, **more))


def check_kept(effect: Effect) -> None:
    """Raise InputError naming the invalid field if model.json cannot hold an effect."""
    try:
        converted(plain(_effect_content(effect, 0.0, 0.0)), EffectPart, "effect")
    except InputError as error:
        raise InputError(f"effect '{effect.name}' could not be kept in a model file: {error}") from None


def check_table(dataset: Dataset) -> None:
    """Raise InputError naming the invalid field if model.json cannot hold a table."""
    try:
        converted(plain(measured_record(Measured(dataset, np.zeros(0, dtype=np.int64)))), MeasuredPart, "table")
    except InputError as error:
        raise InputError(f"{dataset.source!a} could not be kept in a model file: {error}") from None


def save_model(path: Path, saved: SavedModel, **more: object) -> None:
    """Write model.json, after a test that its text can be read. Raises InputError if reading or writing fails."""
    text = model_text(saved, **more)
    try:
        _read(converted(parse_json(text), ModelPart, "model"), saved.mechanism)
    except (InputError, ValueError) as error:
        raise InputError(f"{path.name} is not written, since it could not be read back: {error}") from None
    write_text(path, text)


def load_model(path: Path, mechanism: Mechanism | None = None) -> SavedModel:
    """Read model.json. mechanism: required only for a mechanism built in Python.

    Raises InputError for a missing, too large or changed file, invalid JSON, a file that is no model, an unknown
    schema, an invalid field, or a mechanism that is not the model's.
    """
    part = read_part(path)
    try:
        return _read(part, mechanism)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read(part: ModelPart, given: Mechanism | None) -> SavedModel:
    about = part.mechanism
    choice = MechanismChoice(
        about.name, about.frame, about.payload_kg, about.payload_com_m, about.description or "", about.gravity_m_s2,
        about.added_mass_kg, about.added_moment_kg_m, tuple(about.tool_coms_m.items()),
    )  # fmt: skip
    mechanism = given or choice.load()
    known = same_machine(tip_at_trial(mechanism), about.tip_at_probe_m)
    if tuple(j.name for j in mechanism.joints) != about.joints or not known:
        if given is not None:
            raise InputError(f"a model of '{about.name}'; expected one of {given.name}, the mechanism that is given")
        raise InputError(f"mechanism '{about.name}' has changed since this model was made; calibrate again")
    effects, others = _effects(part.effects), _effects(part.others)
    if odd := [name for e in (*effects, *others) for name in e.inputs if not name.isidentifier()]:
        raise InputError(f"a basis function has the input {odd[0]!r}, expected the name of a column")
    if unknown := [s for e in (*effects, *others) for s in e.slots if s not in places(mechanism)]:
        raise InputError(f"slot '{unknown[0]}' is unknown; available: {choices(unknown[0], places(mechanism))}")
    return SavedModel(
        model=ErrorModel(mechanism, effects),
        theta=np.array([e.value for e in part.effects]),
        stderr=np.array([np.nan if e.stderr is None else e.stderr for e in part.effects]),
        covariance=Covariance(
            _symmetric(part.covariance), part.unknowns, np.array(part.centre_m), others, _symmetric(part.over_causes)
        ),
        placement=Placement(
            {k: np.array(v) for k, v in part.registration.items()},
            {k: np.array(v) for k, v in part.tool.items()},
            {k: _unknowns(k, v) for k, v in part.anchors_m.items()},
        ),
        weights=part.weights_m or _earlier_weights(part),
        sigma=part.sigma_m,
        pose=part.pose,
        input_units=part.input_units,
        ranges=part.ranges,
        measured=None if part.measured is None else measured_from(part.measured, mechanism),
        freedom=np.inf if part.freedom is None else part.freedom,
        noise=part.noise_m,
        discrepancy=part.discrepancy_m,
        noise_shape=None if part.noise_shape is None else np.array(part.noise_shape),
    )


def _effects(parts: Sequence[EffectPart]) -> tuple[Effect, ...]:
    return tuple(
        Effect(
            e.name,
            tuple(Term(t.slot, t.axis, Expression(t.basis), t.weight) for t in e.terms),
            e.unit,
            e.family,
            np.inf if e.prior is None else e.prior,
            taken_up=tuple(TakenUp(r.of, r.label, r.twist) for r in e.taken_up),
        )
        for e in parts
    )


def _symmetric(rows: Sequence[Sequence[float]]) -> Array:
    """Return a symmetric matrix from rows that end at the diagonal or later."""
    lower = np.zeros((len(rows), len(rows)))
    for k, row in enumerate(rows):
        lower[k, : k + 1] = row[: k + 1]
    return lower + np.tril(lower, -1).T


def _effect_content(effect: Effect, value: float, stderr: float) -> dict[str, object]:
    terms = [{"slot": t.slot, "axis": t.axis, "basis": str(t.basis), "weight": t.weight} for t in effect.terms]
    return {
        "name": effect.name, "family": effect.family, "unit": effect.unit, "prior": effect.prior, "value": value,
        "stderr": stderr, "terms": terms, "taken_up": [vars(rigid) for rigid in effect.taken_up],
    }  # fmt: skip
