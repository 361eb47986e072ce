"""Form the whitened linear problem, and the inner products of the columns of all candidate groups of effects."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import Whitening
from gpmodel.mechanism.protocol import AXES, Mechanism, places
from gpmodel.model.effect import Effect
from gpmodel.numerics import rank as ident
from gpmodel.selection.group import Group, Price, Shapes

Site = tuple[str, str]


class Rows:
    """Measured rows of the linear problem, whitened, with the columns of registration and tool projected out.

    The column of an effect is the sensitivity of rows to a unit twist at the effect's site, times the basis function.
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
        """Degrees of freedom: number of measured rows minus number of columns of registration and tool."""
        return len(self.pose_of_row) - int(self.placement.shape[1])

    def clean(self, whitened: Array) -> Array:
        """Project registration and tool out of whitened values, one value per measured row."""
        return whitened - self.placement @ (self.placement.T @ whitened)

    def sensitivity(self, site: Site) -> Array:
        """Return the change of each measured row by a unit twist along one axis of one frame of the chain."""
        slot, axis = site
        if slot not in self._sensitivity:
            blocks = self.problem.observed.sensitivity(places(self.mechanism).index(slot))
            self._sensitivity[slot] = self.problem.weigh(blocks)
        return self._sensitivity[slot][:, AXES.index(axis)]

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Return the weighted derivative of each measured row with respect to the coefficient of each effect."""
        out = np.zeros((len(self.pose_of_row), len(effects)))
        for k, effect in enumerate(effects):
            for term in effect.terms:
                shape = self.shapes(term.basis)[self.pose_of_row]
                out[:, k] += term.weight * self.sensitivity((term.slot, term.axis)) * shape
        return out

    def apart(self, values: Array) -> Array:
        """Arrange values of rows by pose and measured component, with zeros for components that were not measured."""
        measured = self.problem.weights[self.present] > 0
        out = np.zeros((*measured.shape, values.shape[1]))
        out[measured] = values
        return out

    def totals(self, values: Array) -> Array:
        """Sum the values of measured rows over the rows of each pose."""
        return np.add.reduceat(values, self._first, axis=0)


class Atoms:
    """Inner products of vectors with the columns of all effects, from the distinct pairs of site and basis function."""

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
        """Return the inner products of all effects' columns with whitened values of the measured rows."""
        by_pose = self.reach @ self.rows.apart(self.rows.whitening.whiten(values))
        return np.asarray(self.weights @ np.vstack([phi @ by_pose[:, s] for s, phi in enumerate(self.shapes)]))


CHUNK = 400
"""Number of groups of effects whose inner products are formed at once; it affects only memory, a few megabytes."""


@dataclass(frozen=True)
class SizeClass:
    """Groups with equally many effects. ids, index: indices of groups and of their effects. inner, rhs: XᵀX, Xᵀy."""

    ids: IntArray
    index: IntArray
    spreads: Array
    inner: Array
    rhs: Array

    def part(self, at: IntArray) -> "SizeClass":
        """Return a size class (groups with equally many effects) reduced to the groups at positions `at`."""
        return SizeClass(self.ids[at], self.index[at], self.spreads[at], self.inner[at], self.rhs[at])


class GroupPool:
    """Candidate groups and their distinct effects, which groups may share. A group's columns are scaled by `spreads`.

    sizes: number of effects of each group. cost, price, reading: penalties of description, entry and reading of each
    group, nats. block: index of the joint group that contains each group, -1 for none. wholes: index of each joint
    group. shared: description price that further parts of a joint group do not pay, nats: all but the log of the number
    of joints. square, rhs: sum of squares of the whitened target without registration, and its products with the unit
    columns. constant, reading_held, kinds_held: objective, reading prices and kinds of groups of fixed prior variance.
    """

    constant, reading_held, kinds_held = 0.0, 0.0, np.zeros(1, np.int64)

    def __init__(self, rows: Rows, groups: Sequence[Group], prices: Price) -> None:
        self.rows, self.groups, self.prices = rows, tuple(groups), prices
        number: dict[object, int] = {}
        self.effects: list[Effect] = []
        self.index: list[IntArray] = []
        for group in self.groups:
            places = []
            for effect in group.effects:
                if effect.terms not in number:
                    number[effect.terms] = len(self.effects)
                    self.effects.append(effect)
                places.append(number[effect.terms])
            self.index.append(np.array(places, dtype=np.int64))
        self.sizes = np.array([len(index) for index in self.index], dtype=np.int64)
        self.spreads = [np.array(g.spreads) for g in self.groups]
        self.cost = np.array([prices.to_describe(g) for g in self.groups])
        self.price = np.array([prices.to_enter(g) for g in self.groups])
        self.reading = np.array([prices.to_read(g) for g in self.groups])
        self.cap = np.array([g.cap for g in self.groups])
        self.wholes = np.array([g for g, group in enumerate(self.groups) if group.parts and group.family], np.int64)
        blocks = [self.groups[g].parts for g in self.wholes]
        of_part = {part.name: b for b, parts in enumerate(blocks) for part in parts}
        self.block = np.array([of_part.get(g.name, -1) for g in self.groups], dtype=np.int64)
        self.shared = np.array([max(parts[0].cost - math.log(len(parts)), 0.0) for parts in blocks])
        self.atoms = Atoms(rows, self.effects)
        self.rhs, self.square = self.atoms.cross(rows.target[:, None])[:, 0], float(rows.target @ rows.target)
        self.classes = tuple(self._classes())
        self._nothing_formed()

    def _nothing_formed(self) -> None:
        self._columns: dict[int, Array] = {}
        self._crossed: dict[int, Array] = {}
        self._start: dict[int, int] = {}
        self._effects, self._spreads, self._products = np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 0))
        self._gram: tuple[object, Array] = (None, np.zeros((0, 0)))

    def _classes(self) -> list[SizeClass]:
        out = []
        for size in np.unique(self.sizes):
            ids = np.flatnonzero(self.sizes == size)
            index = np.array([self.index[g] for g in ids])
            spreads = np.array([self.spreads[g] for g in ids])
            inner = np.concatenate([self._inner(part) for part in np.array_split(index, max(1, index.size // CHUNK))])
            inner *= spreads[:, :, None] * spreads[:, None, :]
            out.append(SizeClass(ids, index, spreads, inner, self.rhs[index] * spreads))
        return out

    def _inner(self, index: IntArray) -> Array:
        """Return XᵀX of the whitened unit columns X of each group's effects `index`, without registration and tool."""
        count, size = index.shape
        columns = self.rows.whitening.whiten(self.rows.columns([self.effects[e] for e in index.ravel()]))
        placed = self.rows.placement.T @ columns
        stacked = np.ascontiguousarray(columns.T).reshape(count, size, -1)
        taken = np.ascontiguousarray(placed.T).reshape(count, size, -1)
        return stacked @ np.swapaxes(stacked, 1, 2) - taken @ np.swapaxes(taken, 1, 2)

    def crossed(self, g: int) -> Array:
        """Return the inner products of each distinct effect's unit column with the scaled columns of group g."""
        if g not in self._crossed:
            self._crossed[g] = self._crossed_with(g)
        return self._crossed[g]

    def _crossed_with(self, g: int) -> Array:
        return self.atoms.cross(self.columns(g))

    def columns(self, g: int) -> Array:
        """Return the scaled columns of group g, whitened, with registration and tool projected out."""
        if g not in self._columns:
            self._columns[g] = self._cleaned(g)
        return self._columns[g]

    def _cleaned(self, g: int) -> Array:
        own = self.rows.columns([self.effects[e] for e in self.index[g]]) * self.spreads[g]
        return self.rows.clean(self.rows.whitening.whiten(own))

    def gram(self, chosen: Mapping[int, IntArray]) -> Array:
        """Return the inner products of all scaled columns of groups. chosen: remaining effects of each group.

        The inner products of groups are cached, and so is the last result.
        """
        key = tuple((g, c.tobytes()) for g, c in chosen.items())
        if self._gram[0] != key:
            for g in chosen:
                if g not in self._start:
                    self._beside(g)
            at = np.concatenate([self._start[g] + own for g, own in chosen.items()])
            self._gram = key, self._products[at[:, None], at]
        return self._gram[1]

    def _beside(self, g: int) -> None:
        """Add the inner products of the scaled columns of a group to the cache."""
        effects = np.concatenate([self._effects, self.index[g]])
        spreads = np.concatenate([self._spreads, self.spreads[g]])
        new = spreads[:, None] * self.crossed(g)[effects]
        old = len(self._effects)
        products = np.empty((len(effects), len(effects)))
        products[:old, :old], products[:, old:], products[old:, :old] = self._products, new, new[:old].T
        self._start[g], self._effects, self._spreads, self._products = old, effects, spreads, products
