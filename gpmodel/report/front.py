"""The Pareto front of the formulas at a finding's site: gain against length."""

from gpmodel.discovery.state import Discovery
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.description_length import fit_nats
from gpmodel.families.candidate import FORMULAS, Candidate
from gpmodel.formula.length import length
from gpmodel.formula.parse import parse
from gpmodel.model.naming import names_of, translate
from gpmodel.report.schema_search import FormulaRecord
from gpmodel.table.split import JUDGED


def fronts(discovery: Discovery) -> list[tuple[FormulaRecord, ...]]:
    """Formulas in inputs of each finding that was made as a formula, at its site, shortest first; none of others.

    nats = dof/2 · -ln(1 - gain), given everything else in the model fitted to all poses.
    """
    found = discovery.fitted.candidates
    able = [one.found_by in FORMULAS and len(one.effects) == 1 for one in found]
    if not any(able):
        return [()] * len(found)
    residual = residual_of(discovery.found, discovery.poses, Criteria(), JUDGED)
    return [_front(discovery, one, residual) if can else () for one, can in zip(found, able, strict=True)]


def _front(discovery: Discovery, found: Candidate, residual: Residual) -> tuple[FormulaRecord, ...]:
    rest = [c for r in discovery.rounds for c in r.formulas if _replaces(c, found)]
    names, pool = names_of(discovery.poses.dataset), [found, *rest]
    records = [
        FormulaRecord(
            translate(str(c.bases[0]), names),
            length(parse(str(c.bases[0]))),
            float(fit_nats(score.gain, residual.freedom)),
            c is found,
        )
        for c, score in zip(pool, scores(residual.without(found.effects), pool), strict=True)
    ]
    most, kept = 0.0, []
    for record in sorted(records, key=lambda one: (one.nodes, -one.nats)):
        if record.taken or record.nats > most:
            kept.append(record)
            most = max(most, record.nats)
    return tuple(kept)


def _replaces(candidate: Candidate, found: Candidate) -> bool:
    """Return whether a formula acts where the finding acts, in some of its inputs."""
    (term,), own = found.effects[0].terms[:1], candidate.effects
    there = len(own) == 1 and (own[0].terms[0].slot, own[0].terms[0].axis) == (term.slot, term.axis)
    return there and set(candidate.inputs) <= set(found.inputs) and candidate.bases != found.bases
