"""Record effects in a report: size as one number with standard error, shape, displacement of the tool."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from gpmodel.application.exports.sample import at_joint_values
from gpmodel.application.kinematics import with_memory_columns
from gpmodel.application.model_file import saved_model
from gpmodel.application.usable import usable
from gpmodel.arrays import Array, Mask
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.calibration.unmeasured_joints import without_joint_motion
from gpmodel.errors import LISTED, InputError
from gpmodel.families.candidate import NAMED, Candidate, without_phase
from gpmodel.families.catalogue import explained, family
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import AXES, places
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, measured_minus, observe, prepare
from gpmodel.model.sites import names_of, translate
from gpmodel.model.states import PAYLOAD_SHARE, States
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.fitted import finite, statistics_mm, tool_displacements
from gpmodel.report.origin import Origin, ranges
from gpmodel.report.schema import ErrorsMm, Report
from gpmodel.report.schema_search import EffectRecord, MovedRecord, ShapeRecord, TermRecord


@dataclass(frozen=True)
class Quantity:
    """Size of a finding: value ± stderr, the factor of the basis function `basis`."""

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
    """Return the size of a finding as one number, the amplitude, with its standard error. The standard error of the
    amplitude is propagated through the covariance of the effects. The basis function of a harmonic of argument x is
    written sin(x + p), with phase p."""
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
    """Write the basis function that the amplitude of a candidate effect multiplies, as text."""
    first = str(candidate.place.basis)
    if candidate.kind == "harmonic":
        return f"{first[:-1]} {float(np.arctan2(theta[1], theta[0])):+.3f})"
    if candidate.kind != "curve":
        return first
    if len(candidate.bases) > LISTED:
        return _curve_in_words(candidate)
    bases = (f"({b})" if any(sign in str(b) for sign in (" + ", " - ")) else b for b in candidate.bases)
    return " + ".join(f"{t:.4g}*{b}" for t, b in zip(theta, bases, strict=True)).replace("+ -", "- ")


def _curve_in_words(candidate: Candidate) -> str:
    """State the inputs of a smooth term and the number of its basis functions."""
    inputs, count = candidate.inputs, len(candidate.bases)
    of = ", ".join(inputs) if len(inputs) <= LISTED else f"{len(inputs)} inputs"
    waves = all(str(basis).startswith(("sin(", "cos(")) and str(basis).endswith(")") for basis in candidate.bases)
    return f"curve of {of}, {f'{count // 2} harmonics' if waves else f'a sum of {count} terms'}"


def shape(calibration: Calibration, candidate: Candidate, states: States) -> Array:
    """Return the sum of coefficients times basis functions of a finding, along its first axis, at the poses of
    `states`. For one basis function along several axes, the basis function is multiplied by the length of the vector of
    coefficients."""
    if candidate.kind in ("single", "vector"):
        term = candidate.place
        return quantity(calibration, candidate, states).value * term.weight * term.basis(states)
    theta = calibration.theta[indices(calibration, candidate)]
    return np.array([e.terms[0].basis(states) * e.terms[0].weight for e in candidate.effects]).T @ theta


def read_columns(inputs: Sequence[str]) -> list[str]:
    """Return the inputs of an effect for the report, which lists a payload torque as payload and torque."""
    out: list[str] = []
    for name in inputs:
        own = name.startswith(f"{PAYLOAD_SHARE}torque_")
        out += ["payload", name.removeprefix(PAYLOAD_SHARE)] if own else [name]
    return list(dict.fromkeys(out))


WEAK = 0.05
"""Least squared motion of the point by a unit twist, relative to the largest, at plotted poses: √0.05 = 22 %."""


def shape_record(
    final: Calibration, poses: Poses, candidate: Candidate, heldout: Mask, names: Mapping[str, str]
) -> ShapeRecord | None:
    """Return the partial residual of an effect pose by pose: its contribution plus the residual along its column.

    The partial residual is θ φ + l·r / l·l, with contribution θ φ, motion l of the measured components per unit of the
    twist, and residual r, both weighted as in the fit. An effect that the model lacks has the record None.
    """
    mechanism = final.model.mechanism
    poses = resolved(final, poses)
    if not {e.name for e in candidate.effects} <= {e.name for e in final.model.effects}:
        return None
    observed = observe(final.model, poses, final.theta, final.placement)
    difference = measured_minus(observed, poses.dataset)
    measured, residual = np.isfinite(difference), np.nan_to_num(difference)
    weights = measured * observed.scales(final.weights)
    term = candidate.place
    sensitivity = observed.sensitivity(places(mechanism).index(term.slot))
    column = sensitivity[:, :, AXES.index(term.axis)] * term.weight
    column, residual = (without_joint_motion(mechanism, observed, measured, weights * v) for v in (column, residual))
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


POSES = 400
"""Number of random poses for the RMS of an effect over the workspace, known to 4 %: 1 / √(2·400)."""


SHOWN = 120
"""Number of arrows in the picture of an effect."""
Moved = tuple[Array, Array]
"""Points in the root frame, m, and their displacements, m, with the rotation of the tool, rad."""


def over_the_workspace(final: Calibration, poses: Poses, groups: Sequence[Sequence[Effect]]) -> list[Moved | None]:
    """Return the displacements of the tool by groups of effects, at random joint values within the limits.

    Inputs other than joint values are drawn from random rows of the table. Far outside the range of an input, formulas
    outside the catalogue are held constant, as in `predict`. None stands for a group whose effects depend only on the
    session, if joints are unmeasured, or if the model depends on earlier rows whose order is not stated.
    """
    if poses.dataset.joints_approximate:
        return [None] * len(groups)
    saved, rng = usable(saved_model(final, poses), as_measured=True), np.random.default_rng(0)
    try:
        data = with_memory_columns(saved, poses.dataset)
    except InputError:
        return [None] * len(groups)
    anywhere = at_joint_values(data, random_poses(saved.mechanism, POSES, rng, data.q), rng)
    points, moves = tool_displacements(saved, prepare(saved.mechanism, anywhere), groups)
    left = {effect.name for effect in saved.model.effects}
    return [
        (points, move) if any(effect.name in left for effect in group) else None
        for move, group in zip(moves, groups, strict=True)
    ]


def _sizes(moved: Moved | None) -> ErrorsMm:
    return ErrorsMm() if moved is None else statistics_mm(np.linalg.norm(moved[1][:, :3], axis=1))


def _picture(moved: Moved, anywhere: bool) -> MovedRecord:
    """Return displacements of the tool by an effect at no more than 120 points, evenly spaced along the rows."""
    points, moves = (1e3 * values[:, :3][:: max(1, -(-len(values) // SHOWN))] for values in moved)
    return MovedRecord(anywhere, fitted.vectors(np.round(points, 1)), fitted.vectors(moves))


def effect_records(
    final: Calibration,
    poses: Poses,
    candidates: Sequence[Candidate],
    names: Mapping[str, str],
    states: States,
) -> tuple[EffectRecord, ...]:
    """Return the records of candidates fitted to `poses`, with the displacement of the tool at measured and random
    poses.
    names: joint names in the table. states: values of the basis functions' inputs at the poses."""
    groups = [candidate.effects for candidate in candidates]
    if not groups:
        return ()
    points, moves = tool_displacements(final, resolved(final, poses), groups)
    anywhere = over_the_workspace(final, poses, groups)
    alone = fitted.unabsorbed_rms(final, poses, groups)
    out = []
    for candidate, move, far, own in zip(candidates, moves, anywhere, alone, strict=True):
        number = quantity(final, candidate, states)
        at_poses, there = _sizes((points, move)), _sizes(far)
        out.append(
            EffectRecord(
                name=translate(candidate.name, names),
                slot=translate(candidate.place.slot, names),
                axis=candidate.place.axis,
                basis=translate(number.basis, names),
                kind=candidate.kind,
                inputs=tuple(names.get(x, x) for x in read_columns(candidate.inputs)),
                value=number.value,
                stderr=fitted.optional(number.stderr),
                unit=number.unit,
                unique_share=number.unique_share,
                found_by=candidate.found_by,
                catalogue=candidate.family or None,
                explanation=candidate.explanation or explained(candidate.family),
                against=_against(candidate, number, poses),
                terms=tuple(
                    TermRecord(translate(t.slot, names), t.axis, translate(str(t.basis), names), t.weight)
                    for effect in candidate.effects[:LISTED]
                    for t in effect.terms
                ),
                correlated_with=fitted.correlations(final, candidate.effects[:2], names),
                tool_rms_mm=at_poses.rms_mm,
                alone_rms_mm=own,
                tool_max_mm=at_poses.max_mm,
                tool_turn_mrad=1e3 * root_mean_square(np.linalg.norm(move[:, 3:], axis=1)),
                workspace_rms_mm=there.rms_mm,
                workspace_max_mm=there.max_mm,
                of_specification=fitted.of_specification(candidate.effects, at_poses, poses.dataset),
                ranges=ranges(states, candidate.inputs, names),
                moved=_picture(far or (points, move), anywhere=far is not None),
            )
        )
    return tuple(out)


AGAINST = 2.0
"""Number of standard errors below zero at which the value of a compliance is physically impossible."""


IMPOSSIBLE = (
    "The fitted compliance is negative, which is physically impossible. The true cause depends on the same loads, for "
    "example gravity in another direction than described, as on a ceiling or a wall; a controller that corrects for "
    "sag; or wrong masses in the description."
)


def _against(candidate: Candidate, number: Quantity, poses: Poses) -> str:
    """State that the sign of a fitted compliance is impossible; empty if possible, or with measured torques."""
    known = family(candidate.family)
    computed = set(candidate.inputs).isdisjoint(poses.dataset.extras)
    impossible = known is not None and known.yields and computed and number.value <= -AGAINST * number.stderr
    return IMPOSSIBLE if impossible else ""


def from_calibration(ladder: Ladder, origin: Origin) -> Report:
    """Build the report of a calibration with named effects, with the joint names of the table."""
    report = replace(build("calibrate", ladder, origin), effects=tuple(named_effects(ladder)))
    return replace(report, verdict=verdict.of_calibration(report))


def _together(named: tuple[Effect, ...]) -> Iterator[Candidate]:
    """Yield each effect as a candidate; sine and cosine of one argument are one candidate, as in a discovery."""
    for name, group in groupby(named, key=lambda effect: without_phase(effect.name)):
        effects = tuple(group)
        pair = Candidate(name, effects, effects[0].family, 0.0, found_by=NAMED)
        alone = (Candidate(e.name, (e,), e.family, 0.0, found_by=NAMED) for e in effects)
        yield from (pair,) if pair.kind == "harmonic" else alone


def named_effects(ladder: Ladder) -> Iterator[EffectRecord]:
    """Yield the records of named effects at every site; undetermined effects have no standard error."""
    final, names = ladder.final, names_of(ladder.poses.dataset)
    candidates = tuple(_together(ladder.named))
    states = resolved(final, ladder.poses).states
    for candidate, record in zip(
        candidates, effect_records(final, ladder.poses, candidates, names, states), strict=True
    ):
        kept = bool(final.free[indices(final, candidate)].all())
        places = [t for effect in candidate.effects for t in effect.terms]
        bases = "; ".join(dict.fromkeys(str(t.basis) for t in places))
        yield replace(
            record,
            slot=translate(", ".join(dict.fromkeys(t.slot for t in places)), names),
            axis=", ".join(dict.fromkeys(t.axis for t in places)),
            basis=record.basis if candidate.kind == "harmonic" else translate(bases, names),
            inputs=tuple(names.get(x, x) for x in candidate.inputs),
            stderr=record.stderr if kept else None,
            unique_share=record.unique_share if kept else None,
            kept=kept,
        )
