"""All groups offered at one linearised problem, and their inner products."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.model.effect import Effect
from gpmodel.selection.group import Group
from gpmodel.selection.price import Price
from gpmodel.selection.rows import Atoms, Rows

CHUNK = 400
"""Groups whose products are formed at once: a few megabytes."""


@dataclass(frozen=True)
class SizeClass:
    """Groups of K effects each: ids (G,), effect indices (G, K), spreads (G, K), XᵀX (G, K, K) and Xᵀy (G, K)."""

    ids: IntArray
    index: IntArray
    spreads: Array
    inner: Array
    rhs: Array

    def part(self, at: IntArray) -> "SizeClass":
        """Some of the groups."""
        return SizeClass(self.ids[at], self.index[at], self.spreads[at], self.inner[at], self.rhs[at])


class GroupPool:
    """Groups over distinct effects (groups may share them); every column is scaled by its group's spread.

    cost, price, reading: (G,) nats to describe each group, to let it enter, and to read it. kind: (G,) number of
    family and inputs, -1 without a name. block: (G,) number of the kind at several joints that it is a part of, -1 for
    none. shared: (B,) nats that further parts need not say again: all but which of n joints it is. rhs: (E,) products
    of the distinct unit columns with the target, whitened and cleaned.
    """

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
        self.spreads = [np.array(g.spreads) for g in self.groups]
        self.cost = np.array([prices.to_describe(g) for g in self.groups])
        self.price = np.array([prices.to_enter(g) for g in self.groups])
        self.reading = np.array([prices.to_read(g) for g in self.groups])
        self.cap = np.array([g.cap for g in self.groups])
        kinds: dict[object, int] = {}
        named = [(g.family, g.inputs) if g.family else None for g in self.groups]
        self.kind = np.array([-1 if kind is None else kinds.setdefault(kind, len(kinds)) for kind in named])
        blocks = [g.parts for g in self.groups if g.parts and g.family]
        of_part = {part.name: b for b, parts in enumerate(blocks) for part in parts}
        self.block = np.array([of_part.get(g.name, -1) for g in self.groups], dtype=np.int64)
        self.shared = np.array([max(parts[0].cost - math.log(len(parts)), 0.0) for parts in blocks])
        self.atoms = Atoms(rows, self.effects)
        self.rhs = self.atoms.cross(rows.target[:, None])[:, 0]
        self._columns: dict[int, Array] = {}
        self._crossed: dict[int, Array] = {}
        self._between: dict[tuple[int, int], Array] = {}
        self._gram: tuple[object, Array] = (None, np.zeros((0, 0)))
        self.classes = tuple(self._classes())

    def _classes(self) -> list[SizeClass]:
        sizes = np.array([len(i) for i in self.index])
        out = []
        for size in np.unique(sizes):
            ids = np.flatnonzero(sizes == size)
            index = np.array([self.index[g] for g in ids])
            spreads = np.array([self.spreads[g] for g in ids])
            inner = np.concatenate([self._inner(part) for part in np.array_split(index, self._parts(index))])
            inner *= spreads[:, :, None] * spreads[:, None, :]
            out.append(SizeClass(ids, index, spreads, inner, self.rhs[index] * spreads))
        return out

    def _parts(self, index: IntArray) -> int:
        return max(1, index.size // CHUNK)

    def _inner(self, index: IntArray) -> Array:
        """XᵀX (G, K, K) of unit columns, whitened, placement projected out."""
        count, size = index.shape
        columns = self.rows.whitening.whiten(self.rows.columns([self.effects[e] for e in index.ravel()]))
        placed = self.rows.placement.T @ columns
        stacked = np.ascontiguousarray(columns.T).reshape(count, size, -1)
        taken = np.ascontiguousarray(placed.T).reshape(count, size, -1)
        return stacked @ np.swapaxes(stacked, 1, 2) - taken @ np.swapaxes(taken, 1, 2)

    def crossed(self, g: int) -> Array:
        """Products (E, K) of every distinct unit column with the scaled columns of group g."""
        if g not in self._crossed:
            self._crossed[g] = self.atoms.cross(self.columns(g))
        return self._crossed[g]

    def columns(self, g: int) -> Array:
        """Scaled columns (M, K) of a group, whitened and cleaned."""
        if g not in self._columns:
            rows = self.rows
            own = rows.columns([self.effects[e] for e in self.index[g]]) * self.spreads[g]
            self._columns[g] = rows.clean(rows.whitening.whiten(own))
        return self._columns[g]

    def between(self, g: int, h: int) -> Array:
        """Products (K, K') of the scaled columns of two groups."""
        if (g, h) not in self._between:
            self._between[g, h] = self.spreads[g][:, None] * self.crossed(h)[self.index[g]]
        return self._between[g, h]

    def gram(self, chosen: Mapping[int, IntArray]) -> Array:
        """Products (K, K) of the scaled columns of some groups, of those effects that are chosen; the last is kept."""
        key = tuple((g, c.tobytes()) for g, c in chosen.items())
        if self._gram[0] != key:
            ends = np.cumsum([0, *(len(c) for c in chosen.values())])
            out = np.empty((ends[-1], ends[-1]))
            for i, (g, own) in enumerate(chosen.items()):
                for j, (h, others) in enumerate(list(chosen.items())[: i + 1]):
                    block = self.between(g, h)
                    block = block if block.shape == (len(own), len(others)) else block[np.ix_(own, others)]
                    out[ends[i] : ends[i + 1], ends[j] : ends[j + 1]] = block
                    out[ends[j] : ends[j + 1], ends[i] : ends[i + 1]] = block.T
            self._gram = key, out
        return self._gram[1]
