"""The Report of a calibration with the effects that were named."""

from dataclasses import replace

from gpmodel.calibration.result import resolved
from gpmodel.families.catalogue import explained
from gpmodel.model.effect import Effect
from gpmodel.report import fitted, verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.origin import Origin, names_of, ranges
from gpmodel.report.quantity import translate
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord, TermRecord
from gpmodel.report.workspace import over_the_workspace


def from_calibration(ladder: Ladder, origin: Origin) -> Report:
    """Ladder, parameters and named effects, under the table's own names."""
    effects = tuple(_effect(ladder, effect) for effect in ladder.named)
    report = replace(build("calibrate", ladder, origin), effects=effects)
    return replace(report, verdict=verdict.of_calibration(report))


def _effect(ladder: Ladder, effect: Effect) -> EffectRecord:
    final, names = ladder.final, names_of(ladder.poses.dataset)
    i = [e.name for e in final.model.effects].index(effect.name)
    kept = bool(final.kept[i])
    poses = resolved(final, ladder.poses)
    moved = fitted.statistics_mm(fitted.tool_displacement(final, poses, [effect]))
    anywhere = over_the_workspace(final, ladder.poses, [effect])
    return EffectRecord(
        name=translate(effect.name, names),
        slot=translate(", ".join(effect.slots), names),
        axis=", ".join(dict.fromkeys(t.axis for t in effect.terms)),
        basis=translate("; ".join(dict.fromkeys(str(t.basis) for t in effect.terms)), names),
        inputs=tuple(names.get(x, x) for x in effect.inputs),
        value=float(final.theta[i]),
        stderr=fitted.optional(final.stderr[i]),
        unit=effect.unit,
        unique_share=float(final.unique_share[i]) if kept else None,
        found_by="named",
        catalogue=effect.family or None,
        explanation=explained(effect.family),
        kept=kept,
        terms=tuple(
            TermRecord(translate(t.slot, names), t.axis, translate(str(t.basis), names), t.weight) for t in effect.terms
        ),
        correlated_with=fitted.correlations(final, [effect], names),
        tool_rms_mm=moved.rms_mm,
        tool_max_mm=moved.max_mm,
        workspace_rms_mm=anywhere.rms_mm,
        workspace_max_mm=anywhere.max_mm,
        ranges=ranges(poses.states, effect.inputs, names),
    )
