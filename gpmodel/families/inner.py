"""Nonlinear constants in the basis functions of a candidate: a frequency, a time constant, a width, a row number.

A template is the candidate with a symbol in the place of each nonlinear constant.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import NotNegative
from gpmodel.formula.expression import DIGITS, Expression
from gpmodel.model.effect import Effect, Term
from gpmodel.model.memory import constant_of, word

SYMBOL = "CONSTANT"
NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
"""Pattern of a number (the value of a constant) in the name of an effect."""


@dataclass(frozen=True)
class Constant:
    """A constant inside the basis functions of a candidate, such as a width, with a nonlinear influence.

    name: meaning of the constant, such as "time constant".
    unit: unit of `value`.
    step: distance from `value` to the next value of its grid, 0 if the grid is as fine as the poses resolve.
    whole: whether the constant is the last row before an event; the basis functions use the middle between the row
    before and the row after the event.
    rows: first and last row of the 95 % interval of an event, None if unknown.
    number: index of the constant's symbol in the template. least: lower bound of the constant.
    """

    name: str
    unit: str
    value: float
    step: float = 0.0
    whole: bool = False
    number: int = 0
    rows: tuple[int, int] | None = None
    least: float = 0.0

    @property
    def symbol(self) -> str:
        """Symbol of the constant in the names and basis functions of a template."""
        return symbol(self.number)


@dataclass(frozen=True)
class FittedConstant:
    """A nonlinear constant in the basis function of an accepted effect, fitted to all poses.

    name: meaning of the constant, empty for a constant of an evolved formula.
    stderr: standard error of `value`, None for the row of an event.
    low, high: first and last row of the 95 % interval of an event.
    """

    name: str
    unit: str
    value: float
    stderr: NotNegative | None = None
    low: int | None = None
    high: int | None = None


@dataclass(frozen=True)
class NonlinearParameters:
    """The nonlinear constants of a candidate, and its name and effects with symbols for the constants."""

    name: str
    template: tuple[Effect, ...]
    constants: tuple[Constant, ...]

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the nonlinear constants in the candidate's basis functions."""
        return tuple(c.value for c in self.constants)

    def at(self, values: Sequence[float]) -> "NonlinearParameters":
        """Return a copy of the template with new values of the constants inside its basis functions."""
        constants = tuple(replace(c, value=v) for c, v in zip(self.constants, values, strict=True))
        return replace(self, constants=constants)

    def without(self, k: int) -> "NonlinearParameters":
        """Return the template without constant number `k` and without the effects that depend on the constant."""
        whole = re.compile(rf"{self.constants[k].symbol}(?!\d)")
        left = tuple(e for e in self.template if not any(whole.search(str(t.basis)) for t in e.terms))
        unnamed = self.name == law_name(self.template)
        name, left = (law_name(left), numbered(left)) if unnamed else (self.name, left)
        return NonlinearParameters(name, left, (*self.constants[:k], *self.constants[k + 1 :]))

    @property
    def full_name(self) -> str:
        """Name of the candidate, in which the values of its constants replace the symbols."""
        return self._substituted(self.name)

    def read(self, name: str) -> tuple[float, ...] | None:
        """Read the values of the constants from a full name of the candidate; None if the name belongs to another
        candidate or lacks a constant."""
        pattern = re.escape(self.name)
        for constant in self.constants:
            pattern = pattern.replace(constant.symbol, rf"(?P<c{constant.number}>{NUMBER})(?: \(\d+ to \d+\))?", 1)
        found = re.fullmatch(pattern, name)
        values = found.groupdict() if found else {}
        read = [values.get(f"c{c.number}") for c in self.constants]
        return None if None in read else tuple(float(v) for v in read if v is not None)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the candidate with the values of the constants in their basis functions."""
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
        """Replace the symbols in a text by values. between: whether to write the row before an event plus a half."""
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
    """Return the symbol of constant `number` in the names and basis functions of a template."""
    return f"{SYMBOL}{number}"


def geometric(name: str, unit: str, span: tuple[float, float], count: int) -> Iterator[Constant]:
    """Yield `count` trial values of a constant in geometric progression over `span`, rounded to three digits."""
    ratio = (span[1] / span[0]) ** (1.0 / (count - 1))
    for value in np.geomspace(*span, count):
        yield Constant(name, unit, float(f"{value:.3g}"), float(value * (ratio - 1.0)))


def law_name(effects: Sequence[Effect]) -> str:
    """Return a name for a formula from its effects at one site, as `f and g on slot axis`."""
    place = effects[0].terms[0]
    return f"{' and '.join(str(e.terms[0].basis) for e in effects)} on {place.slot} {place.axis}"


def numbered(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Rename the effects of a formula without a name after the formula, with a number if there are several."""
    name = law_name(effects)
    return tuple(replace(e, name=f"{name} [{k}]" if len(effects) > 1 else name) for k, e in enumerate(effects, 1))


NAMES = {"lag": "lag", "play": "half-width", "stop": "half-width"}
"""Meaning of the constant of each column that depends on earlier poses (lag, play, stop)."""


def lag_constants(name: str, effects: Sequence[Effect], unit: Callable[[str, str], str]) -> NonlinearParameters | None:
    """Return the constants in the names of columns of earlier poses, such as the 40 in `lag_temperature_40`, and the
    template. Without a column that depends on earlier poses the result is None.

    name: name of the candidate effect.
    unit: function from the kind of memory (lag, play, stop) and the source column to the unit of the constant.
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
    """Replace the given whole words of a text by symbols of constants."""
    return re.sub(r"\w+", lambda match: symbols.get(match[0], match[0]), text)
