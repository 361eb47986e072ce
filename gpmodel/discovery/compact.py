"""The shortest law of a curve: what was chosen as a sum of many terms, said in one."""

from collections.abc import Iterator

import numpy as np

from gpmodel.discovery.programs import as_candidate, without_poles
from gpmodel.discovery.readable import readable_inputs
from gpmodel.discovery.residual import Residual
from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import targets
from gpmodel.evolution.laws import shortest_laws
from gpmodel.evolution.problems import SlotProblem
from gpmodel.families.candidate import Candidate
from gpmodel.formula.algebra import simplify
from gpmodel.model.sites import Site


def compact_laws(residual: Residual, curve: Candidate, search: Search, seed: int) -> Iterator[Candidate]:
    """Laws of one term, in the inputs of a curve and at its place, that may say what it says.

    residual: without the curve. A law's cost is the curve's own and that of its nodes: the place is the curve's.
    Nothing where the curve has several places or more than two inputs.
    """
    sites = {tuple((t.slot, t.axis, t.weight) for t in effect.terms) for effect in curve.effects}
    count = len(residual.poses)
    rows = np.unique(np.linspace(0, count - 1, min(count, search.evolved_poses)).astype(int))
    inputs, written = readable_inputs(residual.poses.states, rows)
    if len(sites) > 1 or len(curve.inputs) > 2 or not set(curve.inputs) <= set(inputs.names):
        return
    site = Site(next(iter(sites)))
    problem = SlotProblem(inputs, targets(residual, (site,), rows), parsimony=search.nats_per_node)
    between = residual.poses.states.between()
    for law in shortest_laws(problem, 0, curve.inputs, np.random.default_rng(seed)):
        cost = curve.cost + search.nats_per_node * law.complexity
        candidate = as_candidate(simplify(law.program), site, written, cost)
        if candidate and without_poles(residual.criteria, candidate, residual.poses.states, between):
            yield candidate
