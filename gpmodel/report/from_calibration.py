"""The Report of a calibration with the effects that were named."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby

from gpmodel.calibration.result import resolved
from gpmodel.families.candidate import NAMED, Candidate, without_phase
from gpmodel.model.effect import Effect
from gpmodel.model.naming import names_of, translate
from gpmodel.report import verdict
from gpmodel.report.build import Ladder, build
from gpmodel.report.effects import effect_records
from gpmodel.report.origin import Origin
from gpmodel.report.quantity import indices
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord


def from_calibration(ladder: Ladder, origin: Origin) -> Report:
    """Ladder, parameters and named effects, under the table's own names."""
    report = replace(build("calibrate", ladder, origin), effects=tuple(named_effects(ladder)))
    return replace(report, verdict=verdict.of_calibration(report))


def _together(named: tuple[Effect, ...]) -> Iterator[Candidate]:
    """Each effect by itself, but for a sine and the cosine of the same, which are one finding as in a discovery."""
    for name, group in groupby(named, key=lambda effect: without_phase(effect.name)):
        effects = tuple(group)
        pair = Candidate(name, effects, effects[0].family, 0.0, found_by=NAMED)
        alone = (Candidate(e.name, (e,), e.family, 0.0, found_by=NAMED) for e in effects)
        yield from (pair,) if pair.kind == "harmonic" else alone


def named_effects(ladder: Ladder) -> Iterator[EffectRecord]:
    """Yield the records of named effects at every site; undetermined ones have no standard error."""
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
