"""Score decoded programs by the distance of a compensator, or by the description length of an effect at a site."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code, Scores
from gpmodel.evolution.description_length import ranked
from gpmodel.evolution.engine import workspace
from gpmodel.evolution.projection import Targets


def projected_scores(scaled: Array, code: Code, base: int, targets: Targets, parsimony: float) -> Scores:
    """Score every program at every site, with the best set of its columns (programs, columns, poses).

    The columns are the outputs, followed by columns derived from each output, which count the nodes of their output.
    Columns divided by their largest magnitude, in place, are added at a site by forward selection, with coefficients
    solved together (see ``gpmodel.evolution.projection``). The score is the least description length of all sets, in
    nats:
        components / 2 * ln(1 - gain) + parsimony * (nodes of the set + number of columns in it)
    base: number of rows of inputs and fixed constants. A program without gain has the score 0.
    """
    from gpmodel.evolution.kernels.batch import sizes_by_outputs
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
        usable, sizes_by_outputs(code, base), targets.energy, 0.5 * targets.components, parsimony,
        targets.unique_share, scores,
    )  # fmt: skip
    scores.score[:] = ranked(scores.score)
    scores.hashes[:] = code.hashes
    return scores


def distinct_rows(rows: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return the different rows of a table, and for each row of the table the index of its copy among the different
    rows."""
    whole = rows.view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))[:, 0]
    _, first, number = np.unique(whole, return_index=True, return_inverse=True)
    return rows[first], number
