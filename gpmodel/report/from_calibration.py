"""The Report of a calibration with the effects that were named."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby

from gpmodel.calibration.result import resolved
from gpmodel.families.candidate import Candidate, without_phase
from gpmodel.families.catalogue import explained
from gpmodel.model.effect import Effect
from gpmodel.model.naming import names_of, translate
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.origin import Origin, ranges
from gpmodel.report.quantity import indices, quantity
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord, TermRecord
from gpmodel.report.workspace import over_the_workspace


def from_calibration(ladder: Ladder, origin: Origin) -> Report:
    """Ladder, parameters and named effects, under the table's own names."""
    effects = tuple(_effect(ladder, group) for group in _together(ladder.named))
    report = replace(build("calibrate", ladder, origin), effects=effects)
    return replace(report, verdict=verdict.of_calibration(report))


def _together(named: tuple[Effect, ...]) -> Iterator[Candidate]:
    """Each effect by itself, but for a sine and the cosine of the same, which are one finding as in a discovery."""
    for name, group in groupby(named, key=lambda effect: without_phase(effect.name)):
        effects = tuple(group)
        pair = Candidate(name, effects, effects[0].family, 0.0, found_by="named")
        alone = (Candidate(e.name, (e,), e.family, 0.0, found_by="named") for e in effects)
        yield from (pair,) if pair.kind == "harmonic" else alone


def _effect(ladder: Ladder, candidate: Candidate) -> EffectRecord:
    final, names, effects = ladder.final, names_of(ladder.poses.dataset), candidate.effects
    poses = resolved(final, ladder.poses)
    kept = bool(final.kept[indices(final, candidate)].all())
    number = quantity(final, candidate, poses.states)
    moved = fitted.statistics_mm(fitted.tool_displacements(final, poses, [effects])[0])
    anywhere = over_the_workspace(final, ladder.poses, [effects])[0]
    terms = tuple(term for effect in effects for term in effect.terms)
    bases = "; ".join(dict.fromkeys(str(t.basis) for t in terms))
    return EffectRecord(
        name=translate(candidate.name, names),
        slot=translate(", ".join(dict.fromkeys(t.slot for t in terms)), names),
        axis=", ".join(dict.fromkeys(t.axis for t in terms)),
        basis=translate(number.basis if candidate.kind == "harmonic" else bases, names),
        kind=candidate.kind,
        inputs=tuple(names.get(x, x) for x in candidate.inputs),
        value=number.value,
        stderr=fitted.optional(number.stderr) if kept else None,
        unit=number.unit,
        unique_share=number.unique_share if kept else None,
        found_by=candidate.found_by,
        catalogue=candidate.family or None,
        explanation=explained(candidate.family),
        kept=kept,
        terms=tuple(
            TermRecord(translate(t.slot, names), t.axis, translate(str(t.basis), names), t.weight) for t in terms
        ),
        correlated_with=fitted.correlations(final, effects, names),
        tool_rms_mm=moved.rms_mm,
        alone_rms_mm=fitted.moves_alone(final, ladder.poses, [effects])[0],
        tool_max_mm=moved.max_mm,
        workspace_rms_mm=anywhere.rms_mm,
        workspace_max_mm=anywhere.max_mm,
        ranges=ranges(poses.states, candidate.inputs, names),
    )
