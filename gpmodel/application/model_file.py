"""model.json: a fitted model as text, enough to predict and to compensate."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel._version import __version__
from gpmodel.application.measured import Measured, measured_from, measured_record
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.result import Calibration, Covariance
from gpmodel.errors import InputError
from gpmodel.files import to_json, write_text
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism, places
from gpmodel.mechanism.source import MechanismChoice, choice_of
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel, Placement, Poses
from gpmodel.model.measured_torque import measured_torques
from gpmodel.model.memory import clock_of, read_by
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import Dataset

SCHEMA = 1
KIND = "gpmodel model"
TIP_TOLERANCE = 1e-7


@dataclass(frozen=True)
class SavedModel:
    """A fitted model read from text.

    theta, stderr: (E,) in the effects' own SI units, stderr NaN where not fitted. covariance: of registration, tool
    and effects together. rotation_weight: m a radian is worth. sigma: m, one component. pose: whether rotations were
    measured. input_units: units of the extra columns the effects read. ranges: lowest and highest value, SI or the
    table's unit, of the joints and of every column the effects read, over the poses it was fitted to; empty where
    nobody fitted it. measured: the table it was fitted to, where it is kept.
    """

    model: ErrorModel
    theta: Array
    stderr: Array
    covariance: Covariance
    placement: Placement
    rotation_weight: float
    sigma: float
    pose: bool
    input_units: Mapping[str, str]
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    measured: Measured | None = None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that the model corrects."""
        return self.model.mechanism


def saved_model(fit: Calibration, poses: Poses, heldout: IntArray | None = None) -> SavedModel:
    """What of a calibration on `poses` is worth keeping. heldout: rows that no choice has seen."""
    dataset = poses.dataset
    read = needed(fit.model, dataset)
    columns = {*dataset.joints, *(name for effect in fit.model.effects for name in effect.inputs)}
    return SavedModel(
        model=fit.model,
        theta=fit.theta,
        stderr=fit.stderr,
        covariance=fit.covariance,
        placement=fit.placement,
        rotation_weight=fit.rotation_weight,
        sigma=fit.sigma,
        pose=dataset.has_rotation,
        input_units={k: v for k, v in dataset.extra_units.items() if k in read},
        ranges={c: (float(poses.states[c].min()), float(poses.states[c].max())) for c in sorted(columns)},
        measured=Measured(dataset, np.zeros(0, dtype=np.int64) if heldout is None else heldout),
    )


def unfitted(effects: int) -> Covariance:
    """The covariance of a model whose numbers nobody fitted, such as a simulation's truth."""
    return Covariance(np.zeros((effects, effects)), (), np.zeros(3))


def needed(model: ErrorModel, dataset: Dataset) -> set[str]:
    """The columns that a model's effects read: by themselves, those that what they remember is made of, and torques
    that were measured."""
    direct = {name for effect in model.effects for name in effect.inputs}
    remembered = {source for name in direct - set(dataset.extras) for source in read_by(name)}
    clock = clock_of(dataset) if any(name.startswith("lag_") for name in direct) else None
    measured = measured_torques(model.mechanism, dataset)
    torques = {column for joint, column in measured.items() if f"torque_{joint}" in direct | remembered}
    return direct | remembered | torques | ({clock} if clock else set())


def model_text(saved: SavedModel, **more: object) -> str:
    """The text of model.json. more: further JSON content to keep with it, ignored when read.

    Raises InputError for a basis whose text is no expression: such a model lives only in Python.
    """
    mechanism = saved.mechanism
    choice = choice_of(mechanism)
    for effect in saved.model.effects:
        for term in effect.terms:
            Expression(str(term.basis))
    path = Path(choice.name)
    content = {
        "kind": KIND,
        "schema": SCHEMA,
        "version": __version__,
        "mechanism": {
            "name": str(path.resolve()) if path.is_file() else choice.name,
            "frame": choice.frame,
            "payload_kg": choice.payload,
            "payload_com_m": choice.payload_com,
            "joints": [j.name for j in mechanism.joints],
            "tip_at_probe_m": _probe(mechanism),
        },
        "effects": [
            {
                "name": effect.name,
                "family": effect.family,
                "unit": effect.unit,
                "prior": effect.prior,
                "value": value,
                "stderr": stderr,
                "terms": [
                    {"slot": t.slot, "axis": t.axis, "basis": str(t.basis), "weight": t.weight} for t in effect.terms
                ],
            }
            for effect, value, stderr in zip(saved.model.effects, saved.theta, saved.stderr, strict=True)
        ],
        "covariance": saved.covariance.values,
        "unknowns": saved.covariance.placement,
        "centre_m": saved.covariance.centre,
        "ranges": {name: list(limits) for name, limits in saved.ranges.items()},
        "registration": dict(saved.placement.registration),
        "tool": dict(saved.placement.tool),
        "anchors_m": dict(saved.placement.anchors),
        "lever_m": saved.rotation_weight,
        "sigma_m": saved.sigma,
        "pose": saved.pose,
        "input_units": dict(saved.input_units),
        "measured": measured_record(saved.measured),
        **more,
    }
    return to_json(content)


def save_model(path: Path, saved: SavedModel, **more: object) -> None:
    """Write model.json. Raises InputError when it cannot be written."""
    write_text(path, model_text(saved, **more))


def load_model(path: Path, mechanism: Mechanism | None = None) -> SavedModel:
    """Read model.json. mechanism: the one it was made for, where it cannot be loaded by name.

    Raises InputError: missing, no JSON, of another kind or schema, incomplete, or its mechanism is no longer the one it
    was made for.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a model.json") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON ({error}); expected a model.json") from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise InputError(f"{path}: is no model of gpmodel; expected the model.json of calibrate or discover")
    if content.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema {content.get('schema')!r}; this version of gpmodel reads schema {SCHEMA}")
    try:
        return _read(content, path, mechanism)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: damaged model, {type(error).__name__} {error}; make it again") from None


def _mechanism(about: dict[str, Any], folder: Path) -> Mechanism:
    name, com = about["name"], about["payload_com_m"]
    beside = folder / Path(name).name
    return MechanismChoice(
        name=str(beside) if Path(name).suffix and not Path(name).exists() and beside.exists() else name,
        frame=about["frame"],
        payload=about["payload_kg"],
        payload_com=None if com is None else tuple(com),
    ).load()


def _read(content: dict[str, Any], path: Path, given: Mechanism | None) -> SavedModel:
    about = content["mechanism"]
    mechanism = _mechanism(about, path.parent) if given is None else given
    now = _probe(mechanism)
    then = np.array(about["tip_at_probe_m"], dtype=float)
    if [j.name for j in mechanism.joints] != about["joints"] or not np.allclose(now, then, atol=TIP_TOLERANCE, rtol=0):
        raise InputError(f"mechanism '{about['name']}' has changed since this model was made; calibrate again")
    effects = tuple(
        Effect(
            e["name"],
            tuple(Term(t["slot"], t["axis"], Expression(t["basis"]), float(t["weight"])) for t in e["terms"]),
            e["unit"],
            e["family"],
            np.inf if e["prior"] is None else float(e["prior"]),
        )
        for e in content["effects"]
    )
    unknown = [s for e in effects for s in e.slots if s not in places(mechanism)]
    if unknown:
        raise InputError(f"slot '{unknown[0]}' is unknown; available: {', '.join(places(mechanism))}")
    placement = Placement(
        {k: _array(v, (4, 4)) for k, v in content["registration"].items()},
        {k: _array(v, (4, 4)) for k, v in content["tool"].items()},
        {k: _array(v, (3,)) for k, v in content["anchors_m"].items()},
    )
    n, unknowns = len(effects), tuple(content.get("unknowns", ()))
    size = n + len(unknowns)
    stderr = [np.nan if e["stderr"] is None else float(e["stderr"]) for e in content["effects"]]
    return SavedModel(
        model=ErrorModel(mechanism, effects),
        theta=_array([e["value"] for e in content["effects"]], (n,)),
        stderr=np.array(stderr, dtype=float),
        covariance=Covariance(
            _array(content["covariance"], (size, size)) if size else np.zeros((0, 0)),
            unknowns,
            _array(content.get("centre_m", np.zeros(3)), (3,)),
        ),
        placement=placement,
        rotation_weight=float(content["lever_m"]),
        sigma=float(content["sigma_m"]),
        pose=bool(content["pose"]),
        input_units=dict(content["input_units"]),
        ranges={name: (float(low), float(high)) for name, (low, high) in content.get("ranges", {}).items()},
        measured=measured_from(content.get("measured"), mechanism),
    )


def _array(value: Any, shape: tuple[int, ...]) -> Array:
    out = np.array(value, dtype=float)
    if out.shape != shape or not np.isfinite(out).all():
        raise ValueError(f"expected finite numbers of shape {shape}")
    return out


def _probe(mechanism: Mechanism) -> Array:
    """Tip (3,) at one oblique pose: a fingerprint of the nominal geometry."""
    q = 0.1 * np.arange(1.0, len(mechanism.joints) + 1.0)[None]
    return chain(mechanism.transforms(q))[-1][0, :3, 3]
