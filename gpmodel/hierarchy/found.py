"""Which effects the machines of a type have in common: what the search finds on most of them."""

from collections import Counter
from collections.abc import Sequence

from gpmodel.arrays import IntArray
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.progress import Say

Rows = tuple[IntArray, IntArray]


def found_on_most(
    machines: Sequence[tuple[Mechanism, Poses]], rows: Sequence[Rows], seed: int, say: Say
) -> tuple[tuple[Effect, ...], dict[str, int]]:
    """Effects found and confirmed on more than half of the machines, each searched by itself with the catalogue alone;
    and on how many machines each thing was found.

    rows: training and held-out ones of each. Where machines found a curve in more or less detail, the plainest is
    taken, which all of them can tell.
    """
    found: list[Candidate] = []
    for (mechanism, poses), (train, heldout) in zip(machines, rows, strict=True):
        result = discover(mechanism, poses, train, heldout, search=Search(runs=0), seed=seed, progress=say)
        if result.confirmed:
            found += [finding.candidate for finding in result.findings]
    counts = Counter(candidate.name for candidate in found)
    common = [name for name, count in counts.items() if 2 * count > len(machines)]
    plainest = (min((c for c in found if c.name == name), key=lambda c: len(c.effects)) for name in common)
    return tuple(effect for candidate in plainest for effect in candidate.effects), dict(counts.most_common())
