"""Findings in an engineer's terms: one number, its deviation and a basis, whatever the number of unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration
from gpmodel.families.candidate import Candidate
from gpmodel.model.states import PAYLOAD_SHARE, States

MOST_WRITTEN = 6
"""Bases of a curve that are written out one by one; more are counted."""


@dataclass(frozen=True)
class Quantity:
    """value ± stderr of a finding, and the basis it multiplies."""

    value: float
    stderr: float
    basis: str
    unit: str
    unique_share: float


def indices(calibration: Calibration, candidate: Candidate) -> list[int]:
    """Where a candidate's effects sit among the model's."""
    at = {e.name: i for i, e in enumerate(calibration.model.effects)}
    return [at[e.name] for e in candidate.effects]


def quantity(calibration: Calibration, candidate: Candidate, states: States, moved: Array | None = None) -> Quantity:
    """One number for a finding.

    Its amplitude, the deviation propagated through the covariance; of a harmonic the basis is A sin(x + p) with its
    phase p. moved: standard deviations (E,) of its effects over the rivals of other findings, independent of it.
    """
    at = indices(calibration, candidate)
    theta = calibration.theta[at]
    deviation = np.nan_to_num(calibration.stderr[at])
    value, slope = candidate.amplitude(theta, states)
    covariance = calibration.correlation[np.ix_(at, at)] * np.outer(deviation, deviation)
    single = candidate.kind == "single"
    stderr = float(deviation[0]) if single else float(np.sqrt(slope @ covariance @ slope))
    if moved is not None:
        stderr = float(np.hypot(stderr, np.linalg.norm((1.0 if single else slope) * moved)))
    share = float(np.min(calibration.unique_share[at]))
    return Quantity(value, stderr, _basis_in_words(candidate, theta), candidate.unit, share)


def _basis_in_words(candidate: Candidate, theta: Array) -> str:
    """State the basis function that the amplitude of a candidate multiplies."""
    first = str(candidate.place.basis)
    if candidate.kind == "harmonic":
        return f"{first[:-1]} {float(np.arctan2(theta[1], theta[0])):+.3f})"
    if candidate.kind != "curve":
        return first
    if len(candidate.bases) > MOST_WRITTEN:
        return _curve_in_words(candidate)
    return " + ".join(f"{t:.4g}*{b}" for t, b in zip(theta, candidate.bases, strict=True)).replace("+ -", "- ")


def _curve_in_words(candidate: Candidate) -> str:
    """A curve of many bases: its input and what it is a sum of."""
    inputs, count = candidate.inputs, len(candidate.bases)
    of = ", ".join(inputs) if len(inputs) <= MOST_WRITTEN else f"{len(inputs)} inputs"
    waves = all(str(basis).startswith(("sin(", "cos(")) and str(basis).endswith(")") for basis in candidate.bases)
    return f"curve of {of}, {f'{count // 2} harmonics' if waves else f'a sum of {count} terms'}"


def shape(calibration: Calibration, candidate: Candidate, states: States) -> Array:
    """Σ θ φ (N,) of a finding over the poses of `states`, along its first term; of one basis along several axes, φ
    times the length of their vector."""
    if candidate.kind in ("single", "vector"):
        term = candidate.place
        return quantity(calibration, candidate, states).value * term.weight * term.basis(states)
    theta = calibration.theta[indices(calibration, candidate)]
    return np.array([e.terms[0].basis(states) * e.terms[0].weight for e in candidate.effects]).T @ theta


def read_columns(inputs: Sequence[str]) -> list[str]:
    """The inputs of an effect as the report lists them: a payload's own torque is the payload and the torque."""
    out: list[str] = []
    for name in inputs:
        own = name.startswith(f"{PAYLOAD_SHARE}torque_")
        out += ["payload", name.removeprefix(PAYLOAD_SHARE)] if own else [name]
    return list(dict.fromkeys(out))
