"""Findings in an engineer's terms: one number, its standard error and a basis function, for any number of unknowns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.calibration.unmeasured_joints import what_is_left
from gpmodel.errors import LISTED
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.protocol import AXES, places
from gpmodel.model.error_model import Poses, measured_minus, observe
from gpmodel.model.states import PAYLOAD_SHARE, States
from gpmodel.report.fitted import finite
from gpmodel.report.schema_search import ShapeRecord


@dataclass(frozen=True)
class Quantity:
    """Size of a finding: value ± stderr, times the basis function `basis`."""

    value: float
    stderr: float
    basis: str
    unit: str
    unique_share: float


def indices(calibration: Calibration, candidate: Candidate) -> list[int]:
    """Return the indices of a candidate's effects in the model."""
    at = {e.name: i for i, e in enumerate(calibration.model.effects)}
    return [at[e.name] for e in candidate.effects]


def quantity(calibration: Calibration, candidate: Candidate, states: States) -> Quantity:
    """Return the size of a finding as one number: its amplitude.
    The standard error is propagated through the covariance. The basis of a harmonic is A sin(x + p)
    with its phase p."""
    at = indices(calibration, candidate)
    theta = calibration.theta[at]
    deviation = np.nan_to_num(calibration.stderr[at])
    value, slope = candidate.amplitude(theta, states)
    covariance = calibration.correlation[np.ix_(at, at)] * np.outer(deviation, deviation)
    single = candidate.kind == "single"
    stderr = float(deviation[0]) if single else float(np.sqrt(slope @ covariance @ slope))
    share = float(np.min(calibration.unique_share[at]))
    return Quantity(value, stderr, _basis_in_words(candidate, theta), candidate.unit, share)


def _basis_in_words(candidate: Candidate, theta: Array) -> str:
    """Return the basis function that the amplitude of a candidate multiplies, as text."""
    first = str(candidate.place.basis)
    if candidate.kind == "harmonic":
        return f"{first[:-1]} {float(np.arctan2(theta[1], theta[0])):+.3f})"
    if candidate.kind != "curve":
        return first
    if len(candidate.bases) > LISTED:
        return _curve_in_words(candidate)
    return " + ".join(f"{t:.4g}*{b}" for t, b in zip(theta, candidate.bases, strict=True)).replace("+ -", "- ")


def _curve_in_words(candidate: Candidate) -> str:
    """State the inputs of a smooth term and the number of its basis functions."""
    inputs, count = candidate.inputs, len(candidate.bases)
    of = ", ".join(inputs) if len(inputs) <= LISTED else f"{len(inputs)} inputs"
    waves = all(str(basis).startswith(("sin(", "cos(")) and str(basis).endswith(")") for basis in candidate.bases)
    return f"curve of {of}, {f'{count // 2} harmonics' if waves else f'a sum of {count} terms'}"


def shape(calibration: Calibration, candidate: Candidate, states: States) -> Array:
    """Return Σ θ φ (N,) of a finding over the poses of `states`, along its first term.
    For one basis function along several axes, it is φ times the length of the vector."""
    if candidate.kind in ("single", "vector"):
        term = candidate.place
        return quantity(calibration, candidate, states).value * term.weight * term.basis(states)
    theta = calibration.theta[indices(calibration, candidate)]
    return np.array([e.terms[0].basis(states) * e.terms[0].weight for e in candidate.effects]).T @ theta


def read_columns(inputs: Sequence[str]) -> list[str]:
    """Return the inputs of an effect as listed in the report: the torque of a payload is listed
    as payload and torque."""
    out: list[str] = []
    for name in inputs:
        own = name.startswith(f"{PAYLOAD_SHARE}torque_")
        out += ["payload", name.removeprefix(PAYLOAD_SHARE)] if own else [name]
    return list(dict.fromkeys(out))


WEAK = 0.05
"""Least squared motion of the point by a unit twist, relative to the largest, at a pose that is drawn: √0.05 = 22 %."""


def shape_record(
    final: Calibration, poses: Poses, candidate: Candidate, heldout: Mask, names: Mapping[str, str]
) -> ShapeRecord | None:
    """Return the partial residual of a candidate pose by pose: its contribution plus the residual along its column.

    partial = θ φ + l·r / l·l,  l: motion of the measured components per unit of the twist, r: their residual, all
    weighted as in the fit. None if the candidate is not in the model.
    """
    mechanism = final.model.mechanism
    poses = resolved(final, poses)
    if not {e.name for e in candidate.effects} <= {e.name for e in final.model.effects}:
        return None
    observed = observe(final.model, poses, final.theta, final.placement)
    difference = measured_minus(observed, poses.dataset)
    measured, residual = np.isfinite(difference), np.nan_to_num(difference)
    weights = measured * observed.scales(final.rotation_weight)
    term = candidate.place
    sensitivity = observed.sensitivity(places(mechanism).index(term.slot))
    column = sensitivity[:, :, AXES.index(term.axis)] * term.weight
    column, residual = (what_is_left(mechanism, observed, measured, weights * v) for v in (column, residual))
    strength = np.sum(column**2, axis=1)
    seen = strength > WEAK * np.max(strength, initial=1e-30)
    own = shape(final, candidate, poses.states) / term.weight
    partial = own + np.sum(column * residual, axis=1) / np.where(seen, strength, 1.0)
    read = term.basis.inputs if candidate.kind == "single" else candidate.inputs
    inputs = tuple(read) or ("row",)
    x, unit = poses.states[inputs[0]], poses.states.unit(inputs[0])
    x, unit = (np.degrees(x), "deg") if unit == "rad" else (x, unit)
    scale, y_unit = (1e6, "µrad") if term.axis.startswith("R") else (1e3, "mm")
    order = np.argsort(x) if len(inputs) == 1 else np.zeros(0, dtype=int)
    return ShapeRecord(
        effect=0,
        x_name=names.get(inputs[0], inputs[0]),
        x_unit=unit,
        y_unit=y_unit,
        x=finite(x[seen]),
        partial=finite(scale * partial[seen]),
        heldout=tuple(heldout[seen].tolist()),
        rows=tuple(poses.dataset.row[seen].tolist()),
        curve_x=finite(x[order]),
        curve_y=finite(scale * own[order]),
    )
