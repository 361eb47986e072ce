"""Compare all possible changes of a machine by products of their stacked derivatives.

Change i has the whitened derivatives C_i = U_i S_i V_iᵀ. With N the columns of the selected changes, orthonormal, and
z the residual without them, the derivatives given the selected changes are C_i - N Nᵀ C_i, and

    A_i = Nᵀ C_i T_i,   T_i = V_i S_i⁻¹,   I - A_iᵀ A_i = Q G Qᵀ,   W_i = T_i Q G^(-1/2)

where the columns of (C_i - N Nᵀ C_i) W_i are orthonormal, so that change i explains |W_iᵀ C_iᵀ z|² of |z|².
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from gpmodel.application.possible_changes import (
    LEAST,
    PossibleChange,
    corrected,
    log_chances,
    log_likelihood,
)
from gpmodel.application.recheck import Recheck
from gpmodel.arrays import Array, IntArray, Mask

ABSORBED = 1e-12
"""Squared length that the selected changes leave of a unit direction of a change, below which only rounding errors
remain. A hundredth to a hundred times the limit changes nothing: rounding errors are 1e-15."""


@dataclass(frozen=True)
class _Group:
    """Changes of an equal number of columns w. of: indices of the changes (k,). at: indices of their columns (k, w).

    scale: singular values (k, w), zero beyond the rank. turn: matrices T (k, w, w), zero beyond the rank.
    """

    of: IntArray
    at: IntArray
    scale: Array
    turn: Array

    @classmethod
    def made(cls, of: IntArray, at: IntArray, columns: Array) -> Self:
        """Decompose the columns of every change of the group."""
        triangles = np.linalg.qr(np.moveaxis(columns[:, at], 0, 1), mode="r")
        _, s, vt = np.linalg.svd(triangles, full_matrices=False)
        s = np.where(s > 1e-9 * np.maximum(s[:, :1], np.finfo(float).tiny), s, 0.0)
        inverse = np.divide(1.0, s, out=np.zeros_like(s), where=s > 0.0)
        scale, turn = (np.zeros((len(of), *[at.shape[1]] * n)) for n in (1, 2))
        scale[:, : s.shape[1]], turn[:, :, : s.shape[1]] = s, np.swapaxes(vt, 1, 2) * inverse[:, None, :]
        return cls(of, at, scale, turn)

    def given(self, products: Array) -> tuple[Array, IntArray]:
        """Return the matrices W (k, w, w), zero for a change that the selected changes contain, and the ranks (k,).

        products: Nᵀ C of all columns.
        """
        inside = np.moveaxis(products[:, self.at], 0, 1) @ self.turn
        gram = np.eye(self.at.shape[1]) * (self.scale[:, None] > 0.0) - np.swapaxes(inside, 1, 2) @ inside
        squares = self.scale**2
        left = np.sum(squares * np.diagonal(gram, axis1=1, axis2=2), axis=1)
        more = left >= LEAST**2 * squares.sum(axis=1)
        values, vectors = np.linalg.eigh(gram)
        kept = (values > ABSORBED) & more[:, None]
        inverse = np.divide(1.0, np.sqrt(np.maximum(values, ABSORBED)), out=np.zeros_like(values), where=kept)
        return self.turn @ (vectors * inverse[:, None]), kept.sum(axis=1)


@dataclass(frozen=True)
class Stack:
    """Possible changes. columns: whitened derivatives (rows, columns) of all changes side by side."""

    changes: tuple[PossibleChange, ...]
    columns: Array
    groups: tuple[_Group, ...]

    @classmethod
    def of(cls, changes: Sequence[PossibleChange], rows: int) -> Self:
        """Stack possible changes at a number of whitened rows."""
        widths = np.array([change.columns.shape[1] for change in changes], dtype=np.int64)
        columns = np.hstack([np.zeros((rows, 0)), *(change.columns for change in changes)])
        starts = np.cumsum(widths) - widths
        groups = []
        for width in np.unique(widths):
            of = np.flatnonzero(widths == width)
            groups.append(_Group.made(of, starts[of, None] + np.arange(width), columns))
        return cls(tuple(changes), columns, tuple(groups))

    def plus(self, changes: Sequence[PossibleChange]) -> "Stack":
        """Return the stack with further changes."""
        other, count, width = Stack.of(changes, len(self.columns)), len(self.changes), self.columns.shape[1]
        moved = (replace(group, of=group.of + count, at=group.at + width) for group in other.groups)
        columns = np.hstack([self.columns, other.columns])
        return Stack((*self.changes, *other.changes), columns, (*self.groups, *moved))

    @cached_property
    def frames(self) -> Mask:
        """Mask of the displacements of whole frames."""
        return np.array([change.of_a_frame for change in self.changes], dtype=bool)

    @cached_property
    def log_share(self) -> Array:
        """Log prior probability of every change, nats."""
        return np.array([change.log_share for change in self.changes])


@dataclass(frozen=True)
class Compared:
    """All possible changes given selected changes. left: residual without the selected changes. products: Nᵀ C."""

    stack: Stack
    left: Recheck
    products: Array

    @classmethod
    def to(cls, left: Recheck, stack: Stack) -> Self:
        """Compare possible changes without a selected change."""
        return cls(stack, left, np.zeros((0, stack.columns.shape[1])))

    def given(self, left: Recheck) -> "Compared":
        """Compare all changes given a further selected change. left: residual without this change too."""
        more = left.basis[:, self.left.basis.shape[1] :]
        return Compared(self.stack, left, np.vstack([self.products, more.T @ self.stack.columns]))

    def change(self, k: int) -> PossibleChange:
        """Return a change with the columns of the selected changes projected out."""
        return self.stack.changes[k].beside(self.left)

    @cached_property
    def _spans(self) -> list[tuple[Array, IntArray]]:
        return [group.given(self.products) for group in self.stack.groups]

    @cached_property
    def numbers(self) -> IntArray:
        """Number of parameters of every change that the selected changes do not contain."""
        out = np.zeros(len(self.stack.changes), dtype=np.int64)
        for group, (_, ranks) in zip(self.stack.groups, self._spans, strict=True):
            out[group.of] = ranks
        return out

    def of(self, z: Array) -> Array:
        """Return the part of |z|² that every change explains, for z without the columns of the selected changes."""
        pull, out = z @ self.stack.columns, np.zeros(len(self.stack.changes))
        for group, (spans, _) in zip(self.stack.groups, self._spans, strict=True):
            out[group.of] = np.sum((pull[group.at][:, None, :] @ spans)[:, 0] ** 2, axis=1)
        return out

    @cached_property
    def explained(self) -> Array:
        """Part of the chi-square of the residual that every change explains."""
        return self.of(self.left.z)

    @cached_property
    def evidence(self) -> Array:
        """Log posterior probability of every change as the only further change, nats, up to a constant.

        The likelihood is Student's t, since σ is an estimate; p parameters at n rows cost p/2 ln n (Schwarz 1978).
        """
        price = 0.5 * self.numbers * np.log(self.left.degrees)
        return np.asarray(log_likelihood(self.left, self.explained) + self.stack.log_share - price)

    @cached_property
    def chances(self) -> Array:
        """P-value of every change, corrected for its share of the significance level."""
        divides = np.array([change.division > 0.0 for change in self.stack.changes], dtype=bool)
        return corrected(log_chances(self.left, self.explained, self.numbers, divides), self.stack.log_share)
