"""Families of errors of the instrument, such as a laser tracker, in its own frame before registration.

With azimuth a and elevation e, a rotation about the vertical axis is an azimuth error, a rotation about the axis (sin
a, -cos a, 0) an elevation error, and a shift along (cos e cos a, cos e sin a, sin e) a range error. A constant rotation
about z is part of the registration.

If the specification of the instrument is known, the prior standard deviation of each instrument error is the
permissible error at the RMS distance of the measured points. An error larger than specified is a separate candidate,
with the penalty of a defective instrument. A random walk along the rows is a motion of the stand of the instrument,
which no specification covers.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from gpmodel.arrays import Array
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Mechanism
from gpmodel.model.effect import Effect, Term, effect_at
from gpmodel.model.states import Seen, States

ANGLE, LENGTH, SCALE = 3e-5, 5e-5, 2e-5
"""Prior standard deviations of instrument errors, rad, m and m/m: a few times the specification of the worst trackers,
15 µm + 6 µm/m, since an instrument with an error is out of order."""

OUT_OF_ORDER = float(np.log(1000.0))
"""Penalty of an instrument error beyond the specification, nats. With yearly verification to ISO 10360-10, about one
instrument in a thousand is out of order without the knowledge of its user."""

A, E, R = "instrument_azimuth", "instrument_elevation", "instrument_range"

DEGREE = 3
"""Polynomial degree of the instrument's smooth error over the measured volume: a bend and an S shape per direction."""

FINE, FINE_POSES = 5, 200
"""Largest number of half waves, over all directions together, of the instrument's detailed error over the measured
volume; and the least number of poses for the detailed error."""

NEAREST, STEEPEST = 1.0, float(np.radians(85.0))
"""Least distance of a measured point from an instrument that measures angles and a distance, m; and the largest
elevation, rad. If a table is in the robot's frame, its origin is inside the robot."""

WAVES = 8
"""Number of sine waves of a random walk over the rows of a table. The eighth wave has 1/225 of the first's variance."""

FINE_WAVES = 32
"""Number of sine waves of a detailed random walk over the rows. Eight waves leave a fortieth of the walk's variance,
which a step could explain."""


@dataclass(frozen=True)
class _Sizes:
    """Prior standard deviations of the errors of an instrument: a length, m, an angle, rad, and a scale.

    specified: whether the standard deviations come from the specification of the instrument.
    """

    length: float = LENGTH
    angle: float = ANGLE
    scale: float = SCALE
    specified: bool = False


def _sizes(seen: Seen) -> _Sizes:
    if seen.specification is None:
        return _Sizes()
    limit = seen.specification.at(seen.points)
    each = limit / max(seen.specification.distance(seen.points), 1e-3)
    return _Sizes(limit, each, each, True)


def _polar(states: States) -> Seen | None:
    """Return the measured points if an instrument of angles and distance can be at their origin, else None."""
    seen = states.seen
    if seen is None or np.min(seen.columns[R]) < NEAREST or np.max(np.abs(seen.columns[E])) > STEEPEST:
        return None
    return seen


def or_beyond(build: Callable[[Mechanism, States], Iterator[Candidate]]) -> Callable[..., Iterator[Candidate]]:
    """Extend a family of instrument errors by errors beyond the specification, with the penalty OUT_OF_ORDER.

    Without a specification every candidate of the family has the penalty of a defective instrument.
    """

    def offered(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
        for candidate in build(mechanism, states):
            name, cost = candidate.name, candidate.cost + OUT_OF_ORDER
            if candidate.specified:
                yield candidate
                name = f"{name}, beyond its specification"
            yield replace(candidate, name=name, cost=cost, specified=False)

    return offered


def _shift(name: str, factor: str, unit: str, family: str, prior: float) -> Effect:
    """Return an instrument error that shifts the measured point along the beam of the tracker."""
    ways = {"Tx": f"cos({E})*cos({A})", "Ty": f"cos({E})*sin({A})", "Tz": f"sin({E})"}
    terms = tuple(Term(INSTRUMENT, axis, Expression(f"{factor}*{way}")) for axis, way in ways.items())
    return Effect(name, terms, unit, family, prior)


def _by_azimuth(name: str, shape: str, family: str, prior: float) -> Effect:
    return Effect(name, (Term(INSTRUMENT, "Rz", Expression(shape)),), "rad", family, prior)


def _by_elevation(name: str, shape: str, family: str, prior: float) -> Effect:
    turns = (("Rx", f"({shape})*sin({A})", 1.0), ("Ry", f"({shape})*cos({A})", -1.0))
    terms = tuple(Term(INSTRUMENT, axis, Expression(basis), weight) for axis, basis, weight in turns)
    return Effect(name, terms, "rad", family, prior)


def instrument_range(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield an offset and a scale of the distances that the instrument measures."""
    if seen := _polar(states):
        family, size = "instrument_range", _sizes(seen)
        for name, factor, unit, prior, cost in (
            ("range offset of the instrument", "1", "m", size.length, 4.0),
            ("range scale of the instrument", R, "1", size.scale, 4.5),
        ):
            effect = _shift(name, factor, unit, family, prior)
            yield Candidate(name, (effect,), family, cost, specified=size.specified)


def instrument_azimuth(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield errors of the horizontal angle of the instrument, one and two periods per turn, rad."""
    if seen := _polar(states):
        family, size = "instrument_azimuth", _sizes(seen)
        for n, name in ((1, "eccentricity of the instrument's azimuth"), (2, "azimuth of the instrument, 2 per turn")):
            shapes = ((f, f"{f}({n}*{A})") for f in ("sin", "cos"))
            effects = tuple(_by_azimuth(f"{name}, {f}", shape, family, size.angle) for f, shape in shapes)
            yield Candidate(name, effects, family, 4.0, specified=size.specified)


def instrument_elevation(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the index error and the eccentricity of the vertical angle of the instrument, rad."""
    if seen := _polar(states):
        family, size, name = "instrument_elevation", _sizes(seen), "elevation index of the instrument"
        yield Candidate(name, (_by_elevation(name, "1", family, size.angle),), family, 4.0, specified=size.specified)
        name = "eccentricity of the instrument's elevation"
        effects = tuple(_by_elevation(f"{name}, {f}", f"{f}({E})", family, size.angle) for f in ("sin", "cos"))
        yield Candidate(name, effects, family, 4.5, specified=size.specified)


def instrument_axes(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the tilt of the transit axis and of the line of sight: errors by tan and 1/cos of the elevation, rad."""
    if seen := _polar(states):
        family, size = "instrument_axes", _sizes(seen)
        for name, shape in (
            ("tilt of the instrument's transit axis", f"tan({E})"),
            ("collimation of the instrument", f"reciprocal(cos({E}))"),
        ):
            effect = _by_azimuth(name, shape, family, size.angle)
            yield Candidate(name, (effect,), family, 4.5, specified=size.specified)


def instrument_field(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield an error over the measured volume, as polynomials of degree two and three in x, y and z.

    Polynomials of degree one are scale, shear and rotation, which other effects describe.
    """
    if states.seen is None:
        return
    name, size = "smooth error of the instrument over the volume", _sizes(states.seen)
    scaled = [_centred(f"instrument_{axis}", states.seen.columns[f"instrument_{axis}"]) for axis in "xyz"]
    powers = [p for p in product(range(DEGREE + 1), repeat=3) if 2 <= sum(p) <= DEGREE]
    effects: list[Effect] = []
    for power in powers:
        shape = "*".join(f"{text}**{k}" if k > 1 else text for text, k in zip(scaled, power, strict=True) if k)
        effects += _shifts(name, power, shape, size.length / 2)
    yield Candidate(name, tuple(effects), "instrument_field", 5.0, specified=size.specified)
    if len(states) >= FINE_POSES:
        yield _waves(scaled, size)


def _waves(scaled: list[str], size: _Sizes) -> Candidate:
    """Return a detailed error over the measured volume: products of cosines of up to FINE half waves in all.

    Prior standard deviations fall as 1/(1 + k²).
    """
    name = "detailed smooth error of the instrument over the volume"
    effects: list[Effect] = []
    for orders in product(range(FINE + 1), repeat=3):
        if not 1 <= sum(orders) <= FINE:
            continue
        shape = "*".join(f"cos({0.5 * np.pi * k:.6f}*({u} + 1))" for u, k in zip(scaled, orders, strict=True) if k)
        effects += _shifts(name, orders, shape, size.length / (1.0 + sum(k * k for k in orders)))
    return Candidate(name, tuple(effects), "instrument_field", 6.0, specified=size.specified)


def _shifts(name: str, orders: tuple[int, ...], shape: str, prior: float) -> Iterator[Effect]:
    """Yield one error over the measured volume along each axis, named after its orders along x, y and z."""
    label = "".join(f"{c}{k}" for c, k in zip("xyz", orders, strict=True) if k)
    for axis in AXES[:3]:
        yield effect_at(f"{name}, {label} {axis}", INSTRUMENT, axis, Expression(shape), "m", "instrument_field", prior)


def instrument_walk(mechanism: Mechanism, states: States, waves: int = WAVES) -> Iterator[Candidate]:
    """Yield a random walk over the rows, by its Karhunen-Loève waves sin((k - 1/2) π t), t from 0 to 1.

    The prior standard deviation of wave k falls as 1/(k - 1/2). Wave k has its mean 1/((k - 1/2) π) subtracted, so that
    the registration is the mean position of the instrument.
    """
    rows = states.past.columns["row"] if states.past else states["row"]
    if len(rows) < 4 * waves or states.seen is None:
        return
    along = f"(row - {np.min(rows):g})/{max(float(np.ptp(rows)), 1.0):g}"
    orders = np.arange(1, waves + 1) - 0.5
    spread = (1.0 / orders) / np.linalg.norm(1.0 / orders)
    for what, axes, size, unit in (
        ("shift", ("Tx", "Ty", "Tz"), LENGTH, "m"), ("turn", ("Rx", "Ry", "Rz"), ANGLE, "rad"),
        ("turn about its standing axis", ("Rz",), ANGLE, "rad"),
    ):  # fmt: skip
        name = f"walk of the instrument, {what}"
        effects = tuple(
            Effect(
                f"{name} {axis}, wave {k}",
                (Term(INSTRUMENT, axis, Expression(f"sin({np.pi * order:.6f}*{along}) - {1 / (np.pi * order):.6f}")),),
                unit, "instrument_walk", float(size * part),
            )
            for axis in axes
            for k, (order, part) in enumerate(zip(orders, spread, strict=True), 1)
        )  # fmt: skip
        yield Candidate(name, effects, "instrument_walk", 5.0)


def instrument_walks(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield two random walks for a search: a sum of few waves, and a sum of so many waves that it represents steps."""
    yield from instrument_walk(mechanism, states)
    waves = min(FINE_WAVES, len(states) // 4)
    for fine in instrument_walk(mechanism, states, waves) if waves > WAVES else ():
        yield replace(fine, name=f"{fine.name} in detail")


def _centred(column: str, values: Array) -> str:
    """Write a coordinate, scaled to -1 to 1 over the measured volume, as an expression."""
    middle, half = 0.5 * (values.max() + values.min()), max(0.5 * float(np.ptp(values)), 1e-3)
    return f"(({column} - {middle:.4g})/{half:.4g})"
