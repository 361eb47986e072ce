"""Constants inside a candidate, a frequency, a time constant, a width, a row, and its template with their values."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import NotNegative
from gpmodel.formula.expression import DIGITS, Expression
from gpmodel.model.effect import Effect, Term
from gpmodel.model.memory import constant_of, word

SYMBOL = "CONSTANT"


@dataclass(frozen=True)
class Constant:
    """A constant inside the bases of a candidate, which the linear solve cannot reach.

    name: what it is, as in "time constant"; unit: of it. step: from its value to the next that was offered, 0 where it
    is as fine as the poses tell apart. whole: it is the row before an event; bases hold the middle to the next row.
    rows: the first and the last that may be it at 95 %, where they are told. number: of its symbol in the template.
    """

    name: str
    unit: str
    value: float
    step: float = 0.0
    whole: bool = False
    number: int = 0
    rows: tuple[int, int] | None = None

    @property
    def symbol(self) -> str:
        """Symbol of the constant in the names and basis functions of a template."""
        return symbol(self.number)


@dataclass(frozen=True)
class FittedConstant:
    """A constant inside a finding, as all poses have it: value ± stderr, or for the row of an event the first and last
    that may be it, at 95 %. name: what it is, empty for one of an evolved law."""

    name: str
    unit: str
    value: float
    stderr: NotNegative | None = None
    low: int | None = None
    high: int | None = None


@dataclass(frozen=True)
class NonlinearParameters:
    """The constants of a candidate, its name and its effects with their symbols in their places."""

    name: str
    template: tuple[Effect, ...]
    constants: tuple[Constant, ...]

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the constants."""
        return tuple(c.value for c in self.constants)

    def at(self, values: Sequence[float]) -> "NonlinearParameters":
        """The template with other values of its constants."""
        constants = tuple(replace(c, value=v) for c, v in zip(self.constants, values, strict=True))
        return replace(self, constants=constants)

    def without(self, k: int) -> "NonlinearParameters":
        """The template without a constant and the effects that read it."""
        symbol = self.constants[k].symbol
        left = tuple(e for e in self.template if not any(_reads(str(t.basis), symbol) for t in e.terms))
        unnamed = self.name == law_name(self.template)
        name, left = (law_name(left), numbered(left)) if unnamed else (self.name, left)
        return NonlinearParameters(name, left, (*self.constants[:k], *self.constants[k + 1 :]))

    @property
    def full_name(self) -> str:
        """The candidate's name with the constants in it."""
        return self._substituted(self.name)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The candidate's effects with the constants in them."""
        bases = {str(term.basis) for effect in self.template for term in effect.terms}
        filled = {text: Expression(self._substituted(text, between=True)) for text in bases}
        return tuple(
            replace(
                effect,
                name=self._substituted(effect.name),
                terms=tuple(replace(term, basis=filled[str(term.basis)]) for term in effect.terms),
            )
            for effect in self.template
        )

    def _substituted(self, text: str, between: bool = False) -> str:
        """A text with the constants in it. between: rows of events are the middle to the next one."""
        constants = {c.symbol: c for c in self.constants}

        def written(found: re.Match[str]) -> str:
            before, symbol = found.groups()
            if symbol not in constants:
                return found[0]
            constant = constants[symbol]
            value = constant.value + 0.5 if constant.whole and between else constant.value
            if before:
                return f"_{word(value, DIGITS)}"
            first, last = constant.rows or (0, 0)
            return f"{value:.{DIGITS}g}" + (f" ({first} to {last})" if first != last and not between else "")

        return re.sub(rf"(_?)({SYMBOL}\d+)", written, text)


def symbol(number: int = 0) -> str:
    """Return the symbol of a constant, by default the first, in the names and basis functions of a template."""
    return f"{SYMBOL}{number}"


def geometric(name: str, unit: str, span: tuple[float, float], count: int) -> Iterator[Constant]:
    """A constant at `count` values in constant ratio from the lowest to the highest, to three digits."""
    ratio = (span[1] / span[0]) ** (1.0 / (count - 1))
    for value in np.geomspace(*span, count):
        yield Constant(name, unit, float(f"{value:.3g}"), float(value * (ratio - 1.0)))


def law_name(effects: Sequence[Effect]) -> str:
    """Name an unnamed formula from its effects at one site: `f and g on slot axis`."""
    place = effects[0].terms[0]
    return f"{' and '.join(str(e.terms[0].basis) for e in effects)} on {place.slot} {place.axis}"


def numbered(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of a formula without a name, called after it."""
    name = law_name(effects)
    return tuple(replace(e, name=f"{name} [{k}]" if len(effects) > 1 else name) for k, e in enumerate(effects, 1))


def _reads(text: str, symbol: str) -> bool:
    """Return whether a text contains a whole symbol: CONSTANT1 is not in CONSTANT10."""
    return re.search(rf"{symbol}(?!\d)", text) is not None


NAMES = {"lag": "lag", "play": "half-width", "stop": "half-width"}
"""Meaning of the constant of each memory column."""


def remembered(name: str, effects: Sequence[Effect], unit: Callable[[str, str], str]) -> NonlinearParameters | None:
    """The constants in the names of the remembered columns that effects read, as `lag_temperature_40` does; None where
    they read none.

    name: of the candidate they make. unit: of such a constant, by what the column does and to which other.
    """
    read = dict.fromkeys(column for effect in effects for column in effect.inputs if constant_of(column))
    constants, symbols = [], {}
    for number, column in enumerate(read):
        what, of, value = constant_of(column) or ("", "", 0.0)
        constants.append(Constant(NAMES[what], unit(what, of), value, 0.5 * value, number=number))
        symbols[column] = f"{what}_{of}_{symbol(number)}"
    template = tuple(
        replace(e, name=_replaced(e.name, symbols), terms=tuple(_term(t, symbols) for t in e.terms)) for e in effects
    )
    return NonlinearParameters(_replaced(name, symbols), template, tuple(constants)) if constants else None


def _term(term: Term, symbols: Mapping[str, str]) -> Term:
    return replace(term, basis=Expression(_replaced(str(term.basis), symbols)))


def _replaced(text: str, symbols: Mapping[str, str]) -> str:
    """A text with whole words replaced."""
    return re.sub(r"\w+", lambda match: symbols.get(match[0], match[0]), text)
