"""The shortest law of a curve: what was chosen as a sum of many terms, said in one."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, count

import numpy as np

from gpmodel.calibration.gauge import moving_sites
from gpmodel.discovery.judge import plainest
from gpmodel.discovery.one_place import TOGETHER, is_curve, places
from gpmodel.discovery.readable import readable_inputs
from gpmodel.discovery.search import Search
from gpmodel.discovery.standing_out import doubtful, explained, taken_as_measured
from gpmodel.discovery.targets import targets
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import better_by
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import scores
from gpmodel.evolution.laws import laws_at, shorter
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.problems import SlotProblem
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import names
from gpmodel.formula.length import length
from gpmodel.formula.program import Program
from gpmodel.formula.simplification import simplify
from gpmodel.model.effect import Effect
from gpmodel.model.memory import read_by
from gpmodel.model.sites import Site, sites_of
from gpmodel.selection.programs import as_candidate, without_poles

MOST_INPUTS = 6
"""Inputs of what was evolved, of which a law in three may say as much: the others may be there by chance."""

CLEARLY = 2.0
"""Standard errors by which a law predicts better than a curve that saves more: its constants have seen all poses."""


@dataclass(frozen=True)
class LawTask:
    """The search for a law of one curve: all that a worker needs. written: its inputs as the table has them."""

    problem: SlotProblem
    inputs: tuple[str, ...]
    site: Site
    written: Mapping[str, str]


def run_law_task(task: LawTask) -> tuple[Solution, ...]:
    """Laws in the inputs of the curve; the same wherever it runs."""
    return laws_at(task.problem, 0, task.inputs)


@dataclass(frozen=True)
class ShortLaw:
    """A law at a curve's place: its program over the task's inputs, and that as an effect."""

    program: Program
    task: LawTask
    candidate: Candidate

    @property
    def unread(self) -> float:
        """Half the nats of the nodes that nobody reads as such: origins and scales of its inputs."""
        return 0.5 * self.task.problem.parsimony * (self.program.complexity - length(self.program))

    def simplified(self) -> Candidate:
        """The effect as computer algebra writes it; it takes longer than all that is asked of a law before."""
        program, task = simplify(self.program), self.task
        return as_candidate(program, task.site, task.written, self.candidate.cost) or self.candidate


def compact_laws(
    left: Residual, curves: Sequence[Candidate], search: Search
) -> Iterator[tuple[Candidate, Residual, tuple[ShortLaw, ...]]]:
    """Every curve for which laws were found: the curve, the residual without it, and laws of one term, in its inputs
    and at its place, that may say what it says.

    left: what the model leaves that has all the curves. The laws are searched side by side, once more with the poses
    that stand out of the curve taken as they are, where there are any; those that the likeliest law explains are no
    outliers of it, nor of the curve beside it. A law's cost is that of its nodes and of the place: the curve's own, and
    of terms without a name one of all places.
    """
    doubted = [doubtful(left, curve) for curve in curves]
    views = [(left, taken_as_measured(left, out)) if out.any() else (left,) for out in doubted]
    posed = [[t for view in own for t in _posed(view, curve, search)] for curve, own in zip(curves, views, strict=True)]
    found = dict(search.side_by_side(run_law_task, list(chain.from_iterable(posed))))
    numbers = count()
    for curve, tasks, out, (residual, *sharp) in zip(curves, posed, doubted, views, strict=True):
        ways = [partial(_as_laws, residual, curve, task, search) for task in tasks]
        searched = [list(as_laws(law.program for law in found[next(numbers)])) for as_laws in ways]
        if not (laws := list(chain.from_iterable(searched))):
            continue
        if sharp:
            trusted = out & explained(sharp[0].without(curve.effects), [law.candidate for law in laws])
            residual = taken_as_measured(left, trusted)
        residual = residual.without(curve.effects)
        for as_laws, some in zip(ways, searched, strict=True):
            laws += _shortened(some, residual, as_laws) if some else []
        yield curve, residual, tuple(laws)


def replacement(curve: Candidate, residual: Residual, laws: Sequence[ShortLaw]) -> ShortLaw | None:
    """The plainest of the laws that save most in the place of a curve, where it predicts as well within one standard
    error.

    Where it does not predict better by two, the one that saves most has to save so much more as ``_margin`` says. Among
    them an origin or a scale of an input counts half. residual: without the curve. Source: the one-standard-error rule,
    Breiman et al. (1984), 3.4.3.
    """
    criteria = residual.criteria
    own = scores(residual, (curve,))[0].nats
    candidates = [law.candidate for law in laws]
    found = scores(residual, candidates)
    most = max(score.nats for score in found)
    read = [replace(score, nats=score.nats + law.unread) for law, score in zip(laws, found, strict=True)]
    ranked = sorted(zip(candidates, read, strict=True), key=lambda one: -one[1].nats)
    law = laws[candidates.index(plainest(criteria, ranked)[0])]
    worse = better_by(residual, curve.effects, law.candidate.effects) / criteria.standard_errors
    return law if worse < 1.0 and (most >= own + _margin(curve, criteria) or worse < -CLEARLY) else None


def leeway(curves: Iterable[Candidate], criteria: Criteria) -> float:
    """Nats of evidence by which a choice with laws in the places of curves may fall short of one with the curves: by
    what each law need not save, and what it costs to have no name."""
    return max(0.0, sum(criteria.head_start * bool(c.family) - _margin(c, criteria) for c in curves))


def _margin(curve: Candidate, criteria: Criteria) -> float:
    """Nats by which a law has to save more: than what has a name or several, by the head start of named effects for
    each; than a free function, by less than the price of a name; than one evolved term, by what is no tie, and than
    several, which are longer to read, by less than that."""
    said = {curve.family} if curve.family else {effect.family for effect in curve.effects}
    if said.issubset(names()):
        return criteria.head_start * len(said)
    if is_curve(curve):
        return -criteria.naming_margin
    return criteria.tie if len(curve.effects) == 1 else -criteria.tie


def _posed(left: Residual, curve: Candidate, search: Search) -> list[LawTask]:
    """What is searched for a curve: laws of its inputs at its place, and without a name where it would save more;
    nothing where it has several places or more inputs. Of one column remembered in two ways each is asked by itself.
    """
    residual = left.without(curve.effects)
    sites = places(curve)
    poses = len(residual.poses)
    rows = np.unique(np.linspace(0, poses - 1, min(poses, search.evolved_poses)).astype(int))
    inputs, written = readable_inputs(residual.poses.states, rows)
    most = TOGETHER if curve.family else MOST_INPUTS
    columns = len(_columns(curve.inputs))
    if len(sites) > 1 or len(curve.inputs) > most or not set(curve.inputs) <= set(inputs.names):
        return []
    asked = [read for read in combinations(curve.inputs, columns) if len(_columns(read)) == columns]
    own = Site(next(iter(sites)))
    found = []
    for site in dict.fromkeys((own, own if curve.family in names() else _likeliest(residual, curve, own))):
        problem = SlotProblem(inputs, targets(residual, (site,), rows), parsimony=search.nats_per_node)
        found += [LawTask(problem, read, site, written) for read in asked]
    return found


def _likeliest(residual: Residual, curve: Candidate, own: Site) -> Site:
    """The place where a curve saves most, of those along or about an axis like its own, which it stays at where none
    saves more than a tie.

    What evolves sees large errors cut short, and of two places that move the tool nearly alike may take the other.
    """
    kind, mechanism = own.axis[0], residual.calibration.model.mechanism
    sites = [site for site in moving_sites(mechanism, residual.poses.dataset) if site.axis[0] == kind]
    there = [replace(curve, effects=tuple(_at(site, effect) for effect in curve.effects)) for site in sites]
    here, *nats = (score.nats for score in scores(residual, (curve, *there)))
    most, site = max(zip(nats, sites, strict=True), key=lambda one: one[0])
    return site if most > here + residual.criteria.tie else own


def _at(site: Site, effect: Effect) -> Effect:
    """An effect of one place at another."""
    return replace(effect, terms=site.effect("", effect.terms[0].basis, effect.unit).terms)


def _columns(names: Iterable[str]) -> set[str]:
    """The columns of the table that inputs are made of."""
    return {column for name in names for column in read_by(name) or (name,)}


def _as_laws(
    residual: Residual, curve: Candidate, task: LawTask, search: Search, programs: Iterable[Program]
) -> Iterator[ShortLaw]:
    """Programs as effects at the curve's place, without those that pass a pole."""
    states = residual.poses.states
    between = states.between()
    places = len(sites_of(residual.calibration.model.mechanism))
    for program in programs:
        nodes = program.complexity
        cost = curve.cost + search.cost(nodes, 1) if curve.family else search.cost(nodes, places)
        candidate = as_candidate(program, task.site, task.written, cost)
        if candidate and without_poles(residual.criteria, candidate, states, between):
            yield ShortLaw(program, task, candidate)


def _shortened(
    laws: Sequence[ShortLaw], residual: Residual, as_laws: Callable[[Iterable[Program]], Iterator[ShortLaw]]
) -> list[ShortLaw]:
    """The law that saves most less a node at a time, the least missed, for as long as it saves more.

    At the place alone a shorter law that passes a pole may say as much, and hide what is left.
    """
    steps: list[ShortLaw] = []
    most, best = _best(residual, laws)
    while fewer := list(as_laws(shorter(best.program, best.task.problem))):
        saved, best = _best(residual, fewer)
        if saved <= most:
            break
        most = saved
        steps.append(best)
    return steps


def _best(residual: Residual, laws: Sequence[ShortLaw]) -> tuple[float, ShortLaw]:
    """The law that saves most, and what it saves, nats."""
    nats = (score.nats for score in scores(residual, [law.candidate for law in laws]))
    return max(zip(nats, laws, strict=True), key=lambda pair: pair[0])
