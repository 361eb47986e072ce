"""Gain of a basis function by projection: its coefficient is solved, not evolved.

A basis function phi (one value per pose) at site s adds the column ``sensitivity_s * phi`` to a weighted least-squares
problem with the orthonormal columns Q of the model and the residual r. With
    D = squared sensitivity per pose,  B = sensitivity . Q,  g = sensitivity . r,  G = diag(D) - B^T B
the column removes the share ``(phi.g)^2 / (phi^T G phi) / r.r`` of the residual sum of squares. A set Phi of basis
functions is solved together, ``(Phi g)^T (Phi G Phi^T)^-1 (Phi g) / r.r``.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.code import SiteStatistics

UNIQUE_SHARE = 1e-4
"""Default of the least share of a column outside the span of the model's columns, for a gain above zero."""

SMALLEST = 1e-150
"""Magnitude below which a basis function counts as zero, because the squares of its values underflow."""

ROUNDING_SHARE = 1e-8
"""Least share of a column outside the model's columns in noise-free regression; smaller shares are rounding errors."""


@dataclass(frozen=True)
class Targets:
    """Statistics of the residual at every site and pose, from which the gains of basis functions are computed.

    weight: (sites, poses), squared sensitivity of the measurements of a pose to a unit basis function at a site.
    cross: (sites, columns, poses), products of the sensitivities with the orthonormal columns of the model.
    pull: (sites, poses), products of the sensitivities with the residual.
    energy: sum of squares of the residual.
    names: names of the sites.
    samples: number of measured values; 0 for one value per pose.
    Arrays are stored row by row, so that sums have equal rounding errors in every process. Raises InputError if shapes
    disagree or a number is not finite.
    """

    weight: Array
    cross: Array
    pull: Array
    energy: float
    names: tuple[str, ...]
    samples: int = 0
    unique_share: float = UNIQUE_SHARE

    def __post_init__(self) -> None:
        for name in ("weight", "cross", "pull"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))
        sites, poses = self.pull.shape
        if self.weight.shape != (sites, poses) or len(self.names) != sites:
            raise InputError(
                f"targets: weight {self.weight.shape}, {len(self.names)} names, expected ({sites}, {poses})"
            )
        if self.cross.shape[::2] != (sites, poses):
            raise InputError(f"targets: cross {self.cross.shape}, expected ({sites}, columns, {poses})")
        for name in ("weight", "cross", "pull", "energy"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise InputError(f"targets: {name} holds a number that is not finite")

    @property
    def poses(self) -> int:
        """Number of poses in the residual statistics."""
        return int(self.pull.shape[1])

    @property
    def sites(self) -> int:
        """Number of sites at which a program may act."""
        return int(self.pull.shape[0])

    @cached_property
    def is_plain(self) -> bool:
        """True for plain regression: one site, and weight 1 at every pose."""
        return self.sites == 1 and bool(np.all(self.weight == 1.0))

    @cached_property
    def by_column(self) -> Array:
        """The array ``cross`` as (columns, sites, poses), so that sums over the columns run over all sites at once."""
        return np.ascontiguousarray(self.cross.swapaxes(0, 1))

    @cached_property
    def first(self) -> SiteStatistics:
        """Statistics of the residual at the first site in the list `names`."""
        begins = np.asarray(np.argmax(self.cross[0] != 0.0, axis=1), dtype=np.int64)
        return SiteStatistics(
            self.weight[0], self.cross[0], begins, self.pull[0], float(self.energy), self.unique_share
        )

    @cached_property
    def components(self) -> int:
        """Number of measured values: ``samples``, or one per pose."""
        return self.samples or self.poses

    def only(self, site: int) -> "Targets":
        """Return the statistics of the residual at one site."""
        rows = slice(site, site + 1)
        return replace(
            self, weight=self.weight[rows], cross=self.cross[rows], pull=self.pull[rows], names=self.names[rows]
        )

    def set_gain(self, values: Array, site: int) -> tuple[float, Array]:
        """Return the gain of basis functions solved together at one site, and their coefficients.

        values: values of basis functions (functions, poses). A function gets coefficient 0 if its share outside the
        columns of the model and the other functions is below ``unique_share`` (pivoted forward selection, no ridge).
        """
        scale = np.abs(values).max(axis=1, initial=0.0)
        scale = np.where(np.isfinite(scale) & (scale > 0), scale, 1.0)
        scaled = np.where(scale[:, None] > SMALLEST, unit_rows(values), 0.0)
        seen = scaled @ self.cross[site].T
        gram = (scaled * self.weight[site]) @ scaled.T
        total = np.diag(gram).copy()
        gram = gram - seen @ seen.T
        pull = scaled @ self.pull[site]
        chosen = independent(gram, total, self.unique_share)
        coefficients = np.zeros(len(values))
        if not len(chosen) or self.energy <= 0:
            return 0.0, coefficients
        diagonal = np.sqrt(np.diag(gram)[chosen])
        normal = gram[np.ix_(chosen, chosen)] / np.outer(diagonal, diagonal)
        solution = np.linalg.solve(normal, pull[chosen] / diagonal) / diagonal
        coefficients[chosen] = solution / scale[chosen]
        return self.gain_of(values, coefficients, site), coefficients

    def gains(self, values: Array, site: int = 0, given: Array | None = None) -> Array:
        """Return the gain of each of many basis functions (functions, poses) at one site.

        given: values (poses,) of a function with which each of the functions is solved together. A basis function that
        is not finite, is zero, or is in the span of the model's columns (share outside the span below ``unique_share``)
        adds no gain.
        """
        weight, cross, pull, known = self.weight[site], self.cross[site], self.pull[site], 0.0
        if given is not None:  # one more column of the model
            known = float(self.gains(given[None], site)[0]) * self.energy
            shape = unit_rows(given[None])[0] * (known > 0.0)
            column = weight * shape - (cross @ shape) @ cross
            column = column / np.sqrt(max(float(column @ shape), SMALLEST))
            cross, pull = np.vstack([cross, column]), pull - np.sqrt(known) * np.sign(pull @ shape) * column
        scaled = unit_rows(values)
        total = np.square(scaled) @ weight
        unique = total - np.square(scaled @ cross.T).sum(axis=1)
        usable = unique > self.unique_share * total
        added = np.where(usable, (scaled @ pull) ** 2 / np.where(usable, unique, 1.0), 0.0)
        return (known + added) / self.energy if self.energy > 0 else np.zeros(len(values))

    def gain_of(self, values: Array, coefficients: Array, site: int) -> float:
        """Return the gain of basis functions with given coefficients, for example fitted to other poses than those of
        the statistics; the gain is negative if the residual becomes larger."""
        used = coefficients != 0.0
        shape = coefficients[used] @ values[used]
        if not np.all(np.isfinite(shape)) or self.energy <= 0:
            return -np.inf
        column = float(self.weight[site] @ np.square(shape) - np.square(self.cross[site] @ shape).sum())
        return float((2.0 * (shape @ self.pull[site]) - column) / self.energy)

    def shuffled(self, rng: np.random.Generator) -> "Targets":
        """Return the statistics of the residual permuted over the poses: the null hypothesis of the search.

        White noise, projected out of the columns of the model, has a ``pull`` of covariance G (see module) at a site,
        not diag(weight). The pull is therefore whitened by G, permuted alike at all sites, and coloured by G again, so
        that the pull has no part in the span of the columns.
        """
        order = rng.permutation(self.poses)
        pull = np.empty_like(self.pull)
        for site in range(self.sites):
            gram = np.diag(self.weight[site]) - self.cross[site].T @ self.cross[site]
            values, vectors = np.linalg.eigh(gram)
            present = values > 1e-9 * max(values[-1], 0.0)
            values, vectors = np.sqrt(values[present]), vectors[:, present]
            white = vectors @ ((vectors.T @ self.pull[site]) / values)
            pull[site] = vectors @ (values * (vectors.T @ white[order]))
        return replace(self, pull=pull)


def regression(response: Array, name: str = "response") -> Targets:
    """Return plain symbolic regression of ``response`` (points,) as one site with unit sensitivity and an intercept.
    Raises InputError if the response is not finite or constant."""
    response = np.asarray(response, dtype=float)
    if response.ndim != 1 or len(response) < 3 or not np.all(np.isfinite(response)):
        raise InputError(f"{name}: expected at least 3 finite numbers")
    poses = len(response)
    residual = response - response.mean()
    energy = float(residual @ residual)
    if energy <= 0:
        raise InputError(f"{name}: constant, nothing to explain")
    intercept = np.full((1, 1, poses), 1.0 / np.sqrt(poses))
    return Targets(np.ones((1, poses)), intercept, residual[None, :], energy, (name,), poses, ROUNDING_SHARE)


def unit_rows(values: Array) -> Array:
    """Return each row divided by its largest magnitude; a row with a number that is not finite becomes zero."""
    with np.errstate(invalid="ignore"):
        scale = np.maximum(values.max(axis=1, initial=0.0), -values.min(axis=1, initial=0.0))
    usable = np.isfinite(scale) & (scale > 0)
    scaled: Array = values / np.where(usable, scale, 1.0)[:, None]
    scaled[~usable] = 0.0
    return scaled


def independent(gram: Array, total: Array, limit: float) -> NDArray[np.intp]:
    """Return the indices of linearly independent rows of a Gram matrix, by pivoted Cholesky decomposition.

    total: squared norms of the rows before any projection. A row is omitted if its part orthogonal to the selected rows
    is below ``limit`` of its squared norm.
    """
    remaining = gram.astype(float).copy()
    chosen: list[int] = []
    for _ in range(len(gram)):
        share = np.where(total > 0, np.diag(remaining) / np.where(total > 0, total, 1.0), 0.0)
        share[chosen] = 0.0
        pivot = int(np.argmax(share))
        if share[pivot] <= limit:
            break
        chosen.append(pivot)
        column = remaining[:, pivot] / np.sqrt(remaining[pivot, pivot])
        remaining -= np.outer(column, column)
    return np.array(sorted(chosen), dtype=np.intp)
