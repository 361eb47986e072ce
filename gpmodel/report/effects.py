"""Records of the effects in a report, named by the user or found."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from gpmodel.application.exports.sample import at_joint_values
from gpmodel.application.kinematics import remembered
from gpmodel.application.model_file import saved_model
from gpmodel.application.usable import usable
from gpmodel.arrays import Array
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.errors import LISTED, InputError
from gpmodel.families.candidate import NAMED, Candidate, without_phase
from gpmodel.families.catalogue import explained, family
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, prepare
from gpmodel.model.sites import names_of, translate
from gpmodel.model.states import States
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.fitted import statistics_mm, tool_displacements
from gpmodel.report.origin import Origin, ranges
from gpmodel.report.quantity import Quantity, indices, quantity, read_columns
from gpmodel.report.schema import ErrorsMm, Report
from gpmodel.report.schema_search import EffectRecord, MovedRecord, TermRecord

POSES = 400
"""Random joint values for the RMS of an effect over the workspace: known to 4 %, 1 / √(2·400)."""


SHOWN = 120
"""Number of arrows in the picture of an effect."""
Moved = tuple[Array, Array]
"""Points (K, 3), m, and their displacements, m, with the rotation of the tool, rad (K, 6), in the root frame."""


def over_the_workspace(final: Calibration, poses: Poses, groups: Sequence[Sequence[Effect]]) -> list[Moved | None]:
    """Return the displacements of the tool by groups of effects, at random joint values within the limits.

    Other inputs are as in random rows of the table. Far outside their range, formulas without a name keep their value
    at its ends, as in `predict`. None for effects of the session only, for a mechanism with unmeasured joints, or if
    the model depends on earlier rows whose order is not stated.
    """
    if poses.dataset.joints_approximate:
        return [None] * len(groups)
    saved, rng = usable(saved_model(final, poses), as_measured=True), np.random.default_rng(0)
    try:
        data = remembered(saved, poses.dataset)
    except InputError:
        return [None] * len(groups)
    anywhere = at_joint_values(data, random_poses(saved.mechanism, POSES, rng), rng)
    points, moves = tool_displacements(saved, prepare(saved.mechanism, anywhere), groups)
    left = {effect.name for effect in saved.model.effects}
    return [
        (points, move) if any(effect.name in left for effect in group) else None
        for move, group in zip(moves, groups, strict=True)
    ]


def _sizes(moved: Moved | None) -> ErrorsMm:
    return ErrorsMm() if moved is None else statistics_mm(np.linalg.norm(moved[1][:, :3], axis=1))


def _picture(moved: Moved, anywhere: bool) -> MovedRecord:
    """Return the displacements at equally spaced points, at most SHOWN."""
    points, moves = (1e3 * values[:, :3][:: max(1, -(-len(values) // SHOWN))] for values in moved)
    return MovedRecord(anywhere, fitted.vectors(np.round(points, 1)), fitted.vectors(moves))


def effect_records(
    final: Calibration,
    poses: Poses,
    candidates: Sequence[Candidate],
    names: Mapping[str, str],
    states: States,
) -> tuple[EffectRecord, ...]:
    """Return the records of candidates as fitted to `poses`, with their displacement of the tool at measured and random
    poses.
    names: names in the table. states: inputs at the poses."""
    groups = [candidate.effects for candidate in candidates]
    if not groups:
        return ()
    points, moves = tool_displacements(final, resolved(final, poses), groups)
    anywhere = over_the_workspace(final, poses, groups)
    alone = fitted.moves_alone(final, poses, groups)
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
                explanation=_explanation(candidate, number, poses),
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
"""Standard errors below zero at which a compliance is impossible."""


def _explanation(candidate: Candidate, number: Quantity, poses: Poses) -> str:
    """Explain a finding; for a compliance also whether its sign is possible. Measured torques keep their signs."""
    said = candidate.explanation or explained(candidate.family)
    known = family(candidate.family)
    computed = set(candidate.inputs).isdisjoint(poses.dataset.extras)
    if known is None or not known.yields or not computed or number.value > -AGAINST * number.stderr:
        return said
    return (
        f"{said}. The fitted compliance is negative, which is physically impossible. The true cause depends "
        "on the same "
        "loads, for example a controller that corrects for sag, or wrong masses in the description"
    )


def from_calibration(ladder: Ladder, origin: Origin) -> Report:
    """Build the report of a calibration with its named effects, in the names of the table."""
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
        kept = bool(final.kept[indices(final, candidate)].all())
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
