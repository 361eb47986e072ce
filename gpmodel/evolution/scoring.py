"""Score decoded programs by the distance of a compensator, or by the description length of an effect at a site."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.code import Code
from gpmodel.evolution.description_length import ranked
from gpmodel.evolution.engine import sizes, values, workspace
from gpmodel.evolution.projection import Targets


@dataclass(frozen=True)
class Scores:
    """Scores of evolved programs, one row per program.

    score: value that the evolution minimises.
    gain: share of the residual that the program removes.
    complexity: number of nodes of the outputs in use.
    site: number of the program's best site.
    chosen: bit set of the outputs in use.
    hashes: hash of the effective code.
    """

    score: Array
    gain: Array
    complexity: IntArray
    site: IntArray
    chosen: IntArray
    hashes: NDArray[np.uint64]

    @staticmethod
    def empty(count: int) -> "Scores":
        """Allocate arrays for the scores of `count` programs."""
        complexity, site, chosen = (np.zeros(count, np.int64) for _ in range(3))
        return Scores(np.empty(count), np.empty(count), complexity, site, chosen, np.empty(count, np.uint64))

    def __setitem__(self, part: slice | NDArray[np.intp], other: "Scores") -> None:
        for name in ("score", "gain", "complexity", "site", "chosen", "hashes"):
            getattr(self, name)[part] = getattr(other, name)

    def take(self, rows: NDArray[np.intp]) -> "Scores":
        """Return the scores of the programs with the given row numbers."""
        return Scores(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def join(self, other: "Scores") -> "Scores":
        """Return the scores of this population followed by the scores of ``other``."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in self.__dataclass_fields__)
        return Scores(*(np.concatenate(pair) for pair in pairs))


def slot_scores(code: Code, fixed: Array, targets: Targets, parsimony: float) -> Scores:
    """Score every program at every site, with the best set of its outputs.

    Outputs divided by their largest magnitude are added at a site by forward selection, with coefficients solved
    together (see ``gpmodel.evolution.projection``). The score is the least description length of all sets, in nats:
        components / 2 * ln(1 - gain) + parsimony * (nodes of the set + number of outputs in it)
    fixed: values (rows, poses) of inputs and constants. A program without gain scores 0.
    """
    return projected_scores(values(code, fixed), code, len(fixed), targets, parsimony)


def projected_scores(scaled: Array, code: Code, base: int, targets: Targets, parsimony: float) -> Scores:
    """Return scores from the values (programs, columns, poses) of columns, which are scaled in place.

    The columns are the outputs, followed by columns derived from each output. A derived column counts the nodes of its
    output. base: number of rows of inputs and fixed constants.
    """
    from gpmodel.evolution.kernels.selection import choose_outputs, scale_and_multiply

    programs, outputs, poses = scaled.shape
    usable = np.empty((programs, outputs), dtype=bool)
    count = outputs * (outputs + 1) // 2
    pairs = workspace("pairs", (programs, count, 0 if targets.is_plain else poses))
    scale_and_multiply(scaled, usable, pairs)
    if targets.is_plain:
        first, second = np.triu_indices(outputs)
        products = np.ascontiguousarray((scaled @ scaled.transpose(0, 2, 1))[:, first, second])
    else:
        products = pairs.reshape(-1, poses) @ targets.weight.T
    flat = scaled.reshape(-1, poses)
    rows, number = (flat, np.arange(len(flat))) if targets.is_plain else distinct_rows(flat)
    columns = targets.by_column.reshape(-1, poses)
    seen = np.matmul(rows, columns.T, out=workspace("seen", (len(rows), len(columns))))
    pull = flat @ targets.pull.T
    scores = Scores.empty(programs)
    choose_outputs(
        products.reshape(programs, -1, targets.sites),
        seen.reshape(len(rows), -1, targets.sites), number.reshape(programs, outputs),
        pull.reshape(programs, outputs, targets.sites),
        usable, sizes(code, base), targets.energy, 0.5 * targets.components, parsimony, targets.unique_share,
        scores.score, scores.gain, scores.complexity, scores.site, scores.chosen,
    )  # fmt: skip
    scores.score[:] = ranked(scores.score)
    scores.hashes[:] = code.hashes
    return scores


def distinct_rows(rows: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return the different rows of a table, and for each row of the table the number of its copy among them."""
    whole = rows.view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))[:, 0]
    _, first, number = np.unique(whole, return_index=True, return_inverse=True)
    return rows[first], number
