"""Constants inside a candidate, a frequency, a time constant, a width, a row, and its template with their values."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect
from gpmodel.model.memory import word

DIGITS = 6
"""Of a constant as it is written: a millionth of it changes no basis by as much as its deviation does."""


@dataclass(frozen=True)
class Constant:
    """A constant inside the bases of a candidate, which the linear solve cannot reach.

    name: what it is, as in "time constant"; unit: of it. step: from its value to the next that was offered, 0 where it
    is as fine as the poses tell apart. whole: it is the row before an event; bases hold the middle to the next row.
    number: of its symbol in the template.
    """

    name: str
    unit: str
    value: float
    step: float = 0.0
    whole: bool = False
    number: int = 0

    @property
    def symbol(self) -> str:
        """What stands for it in the names and bases of a template."""
        return symbol(self.number)


@dataclass(frozen=True)
class Inner:
    """The constants of a candidate, its name and its effects with their symbols in their places."""

    name: str
    template: tuple[Effect, ...]
    constants: tuple[Constant, ...]

    @property
    def values(self) -> tuple[float, ...]:
        """Of the constants."""
        return tuple(c.value for c in self.constants)

    def at(self, values: Sequence[float]) -> "Inner":
        """The same with other values of its constants."""
        constants = tuple(replace(c, value=v) for c, v in zip(self.constants, values, strict=True))
        return replace(self, constants=constants)

    def without(self, k: int) -> "Inner":
        """The same without a constant and the effects that read it."""
        symbol = self.constants[k].symbol
        left = tuple(e for e in self.template if not any(symbol in str(t.basis) for t in e.terms))
        return replace(self, template=left, constants=(*self.constants[:k], *self.constants[k + 1 :]))

    @property
    def said(self) -> str:
        """The candidate's name with the constants in it."""
        text = self.name
        for c in self.constants:
            text = text.replace(c.symbol, f"{c.value:.{DIGITS}g}")
        return text

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The candidate's effects with the constants in them."""
        return tuple(self._filled(effect) for effect in self.template)

    def _filled(self, effect: Effect) -> Effect:
        terms = tuple(replace(t, basis=Expression(self._written(str(t.basis)))) for t in effect.terms)
        return replace(effect, name=replace(self, name=effect.name).said, terms=terms)

    def _written(self, basis: str) -> str:
        for c in self.constants:
            value = c.value + 0.5 if c.whole else c.value
            basis = basis.replace(f"_{c.symbol}", f"_{word(value, DIGITS)}").replace(c.symbol, f"{value:.{DIGITS}g}")
        return basis


def symbol(number: int = 0) -> str:
    """What stands for a constant, the first by default, in the names and bases of a template."""
    return f"CONSTANT{number}"


def geometric(name: str, unit: str, span: tuple[float, float], count: int) -> Iterator[Constant]:
    """A constant at `count` values in constant ratio from the lowest to the highest, to three digits."""
    ratio = (span[1] / span[0]) ** (1.0 / (count - 1))
    for value in np.geomspace(*span, count):
        yield Constant(name, unit, float(f"{value:.3g}"), float(value * (ratio - 1.0)))
