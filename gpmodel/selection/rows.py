"""The rows of one linearised problem: whitened, the placement taken out, columns as sensitivity times shape."""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import Whitening
from gpmodel.mechanism.protocol import AXES, Mechanism, places
from gpmodel.model.effect import Effect
from gpmodel.numerics import rank as ident
from gpmodel.selection.group import Shapes

Site = tuple[str, str]


class Rows:
    """M weighted rows: what a unit twist at each place does (M,), whitened inner products, placement projected out.

    A column is a sensitivity times a shape, x = r ∘ φ(pose of row), so Xᵀv = Φᵀ (sums of r ∘ v over each pose).
    """

    def __init__(
        self, mechanism: Mechanism, problem: Linearised, target: Array, whitening: Whitening, shapes: Shapes
    ) -> None:
        self.mechanism, self.problem, self.whitening, self.shapes = mechanism, problem, whitening, shapes
        self.pose_of_row = problem.pose_of_row
        self.present, self._first = np.unique(self.pose_of_row, return_index=True)
        self._sensitivity: dict[str, Array] = {}
        placed = whitening.whiten(problem.columns[:, : problem.placement])
        scale = np.linalg.norm(placed, axis=0)
        self.placement = ident.orthonormal(placed / np.where(scale > 0, scale, 1.0))
        self.target = self.clean(whitening.whiten(target))

    @property
    def freedom(self) -> int:
        """Rows less what the placement takes."""
        return len(self.pose_of_row) - int(self.placement.shape[1])

    def clean(self, whitened: Array) -> Array:
        """Whitened rows less what the placement explains."""
        return whitened - self.placement @ (self.placement.T @ whitened)

    def sensitivity(self, site: Site) -> Array:
        """Rows (M,) of a unit twist along one axis of one slot."""
        slot, axis = site
        if slot not in self._sensitivity:
            blocks = self.problem.observed.sensitivity(places(self.mechanism).index(slot))
            self._sensitivity[slot] = self.problem.weigh(blocks)
        return self._sensitivity[slot][:, AXES.index(axis)]

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Columns (M, E) of unit unknowns, weighted like the residual, neither whitened nor projected."""
        out = np.zeros((len(self.pose_of_row), len(effects)))
        for k, effect in enumerate(effects):
            for term in effect.terms:
                shape = self.shapes(term.basis)[self.pose_of_row]
                out[:, k] += term.weight * self.sensitivity((term.slot, term.axis)) * shape
        return out

    def apart(self, values: Array) -> Array:
        """Values (M, K) pose by pose (P, m, K), zero where nothing was measured."""
        measured = self.problem.weights[self.present] > 0
        out = np.zeros((*measured.shape, values.shape[1]))
        out[measured] = values
        return out

    def totals(self, values: Array) -> Array:
        """Sums (P, K) over the rows of each pose of values (M, K)."""
        return np.add.reduceat(values, self._first, axis=0)


class Atoms:
    """Products with very many columns at once: the distinct (place, shape) pairs of all effects, place by place."""

    def __init__(self, rows: Rows, effects: Sequence[Effect]) -> None:
        self.rows = rows
        atoms: dict[Site, dict[str, int]] = {}
        values: dict[Site, list[Array]] = {}
        for effect in effects:
            for term in effect.terms:
                site, text = (term.slot, term.axis), str(term.basis)
                of_site = atoms.setdefault(site, {})
                if text not in of_site:
                    of_site[text] = len(of_site)
                    values.setdefault(site, []).append(rows.shapes(term.basis)[rows.present])
        self.shapes = [np.array(v) for v in values.values()]
        reach = np.array([rows.sensitivity(site) for site in values]).reshape(len(values), len(rows.pose_of_row))
        self.reach = np.ascontiguousarray(np.swapaxes(rows.apart(reach.T), 1, 2))
        start = dict(zip(atoms, np.cumsum([0, *(len(a) for a in atoms.values())]), strict=False))
        entries = [
            (k, start[(t.slot, t.axis)] + atoms[(t.slot, t.axis)][str(t.basis)], t.weight)
            for k, effect in enumerate(effects)
            for t in effect.terms
        ]
        at, of, weight = zip(*entries, strict=True) if entries else ((), (), ())
        count = sum(len(a) for a in atoms.values())
        self.weights = sparse.csr_matrix((weight, (at, of)), shape=(len(effects), count))

    def cross(self, values: Array) -> Array:
        """Xᵀ W v (E, K) for cleaned, whitened values (M, K)."""
        by_pose = self.reach @ self.rows.apart(self.rows.whitening.whiten(values))
        return np.asarray(self.weights @ np.vstack([phi @ by_pose[:, s] for s, phi in enumerate(self.shapes)]))
