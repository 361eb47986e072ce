"""Coefficients of the terms of a law under a link, by least squares, and as few of them free as they are worth."""

from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.links import BROKEN_POWER, FITS, Link, LinkTerm, assembled
from gpmodel.formula.program import Program


def solved(
    terms: list[LinkTerm], link: Link, columns: Mapping[str, Array], response: Array, price: float
) -> Program | None:
    """The law of some terms with their coefficients by least squares, as few of them free as ``price`` nats allow.

    A term that is worth less is left out, and an exponent becomes the nearest multiple of a half where that costs less
    than writing another: only so has the power of a negative number its sign. None where no term is left or the columns
    are no numbers.
    """
    root, there = link.root_weights(response), link.forward(response)
    table = np.stack([term.column(columns, response) for term in terms], axis=1)
    if not np.all(np.isfinite(table)):
        return None
    values = np.stack([term.values_below(columns, len(response)) for term in terms])
    with np.errstate(all="ignore"):
        if link.quotient:
            root = _over_denominator(values, table, response)
        for _ in range(FITS - 1 if link.weighted else 0):
            fit = link.at_fit(response, table @ _solution(root[:, None] * table, root * there))
            root, there = fit if np.all(np.isfinite(fit)) else (root, there)
    there, table = root * there, root[:, None] * table
    scale = np.abs(table).max(axis=0)
    free = np.flatnonzero(scale > 0).tolist()
    held: dict[int, float] = {}
    while free:
        part, rest = table[:, free] / scale[free], there - table @ _filled(held, len(terms))
        triangle = np.linalg.qr(part)[1]
        diagonal = np.abs(np.diag(triangle))
        if diagonal.min() <= 1e-10 * diagonal.max():
            free.pop(int(diagonal.argmin()))
            continue
        found = np.linalg.lstsq(part, rest, rcond=None)[0]
        simple = np.array(
            [link.simplest(terms[k].program, c) for k, c in zip(free, (found / scale[free]).tolist(), strict=True)]
        )
        loss = _losses(part, rest, found, simple * scale[free], triangle)
        worth = price * (BROKEN_POWER if link.logarithms else 1)
        if loss.min() >= worth:
            held |= dict(zip(free, (found / scale[free]).tolist(), strict=True))
            break
        place = int(loss.argmin())
        held[free.pop(place)] = float(simple[place])
    kept = sorted(k for k in held if held[k])
    one = 1.0 + sum(held[k] * float(values[k].mean()) for k in kept)
    with np.errstate(all="ignore"), suppress(InputError):
        return assembled([terms[k] for k in kept], [held[k] / one for k in kept], link) if kept and one else None
    return None


def _over_denominator(values: Array, table: Array, response: Array) -> Array:
    """What the errors (N,) of a quotient's linear problem are multiplied by to be those of the response.

    values (terms, N): what stands below the bar, else 0.
    """
    size = np.abs(1.0 - _solution(table, response) @ (values - values.mean(axis=1, keepdims=True)))
    return np.asarray(size.min() / size) if size.min() > 0 else np.ones_like(response)


def _solution(table: Array, there: Array) -> Array:
    """Coefficients of columns (N, k) by least squares, whatever their sizes."""
    scale = np.abs(table).max(axis=0, initial=1e-300)
    return np.asarray(np.linalg.lstsq(table / scale, there, rcond=None)[0] / scale)


def _filled(held: dict[int, float], count: int) -> Array:
    found = np.zeros(count)
    found[list(held)] = list(held.values())
    return found


def _losses(part: Array, there: Array, found: Array, simple: Array, triangle: Array) -> Array:
    """Nats lost where one coefficient of a least-squares solution is held at another value, the others solved anew."""
    rest = there - part @ found
    floor = (1e-14 * np.abs(part) @ np.abs(found)).max() ** 2 * len(there)
    variances = np.square(np.linalg.inv(triangle)).sum(axis=1)
    return np.asarray(0.5 * len(there) * np.log1p((found - simple) ** 2 / variances / max(float(rest @ rest), floor)))
