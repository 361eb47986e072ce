"""What a report says of any enabled effect, whether it was named or found."""

from collections.abc import Mapping, Sequence

from gpmodel.calibration.result import Calibration, resolved
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import explained
from gpmodel.model.error_model import Poses
from gpmodel.model.naming import translate
from gpmodel.model.states import States
from gpmodel.report import fitted
from gpmodel.report.origin import ranges
from gpmodel.report.quantity import quantity, read_columns
from gpmodel.report.schema_search import EffectRecord, TermRecord
from gpmodel.report.workspace import over_the_workspace

MOST_TERMS = 6
"""Effects whose terms are listed of one finding; a curve has dozens and its basis says so."""


def effect_records(
    final: Calibration, poses: Poses, candidates: Sequence[Candidate], names: Mapping[str, str], states: States
) -> tuple[EffectRecord, ...]:
    """Candidates as a fit to `poses` has them, each with what it moves the tool by at the measured poses and anywhere.

    names: of the table. states: of the poses.
    """
    groups = [candidate.effects for candidate in candidates]
    if not groups:
        return ()
    moved = map(fitted.statistics_mm, fitted.tool_displacements(final, resolved(final, poses), groups))
    anywhere = over_the_workspace(final, poses, groups)
    alone = fitted.moves_alone(final, poses, groups)
    out = []
    for candidate, here, there, own in zip(candidates, moved, anywhere, alone, strict=True):
        number = quantity(final, candidate, states)
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
                terms=tuple(
                    TermRecord(translate(t.slot, names), t.axis, translate(str(t.basis), names), t.weight)
                    for effect in candidate.effects[:MOST_TERMS]
                    for t in effect.terms
                ),
                correlated_with=fitted.correlations(final, candidate.effects[:2], names),
                tool_rms_mm=here.rms_mm,
                alone_rms_mm=own,
                tool_max_mm=here.max_mm,
                workspace_rms_mm=there.rms_mm,
                workspace_max_mm=there.max_mm,
                of_specification=fitted.of_specification(candidate.effects, here, poses.dataset),
                ranges=ranges(states, candidate.inputs, names),
            )
        )
    return tuple(out)
