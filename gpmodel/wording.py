"""Write numbers for engineers: an SI prefix, and as many digits as the standard error justifies."""

import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

WIDTH, NAME = 80, 24
"""Number of characters of a line on a terminal, and of a name in a table on the terminal."""

_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
OF_LISTS = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
"""Conversion factor and unit in which a list of numbers shows lengths and angles."""
_LEADING = re.compile(r"^(rad|m)(?=$|[/*·])")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
DRIFTING_REPEATS = "repeats of a pose differ more the more rows are between them, as in a drift"
"""Reason for which repeats are no measure of the noise."""

UNKNOWN = "–"
_TOGETHER = re.compile(r"(?<=\d) (?=%)|(?<=±) | (?=±)")
"""Spaces, as between number and unit, at which a line must not be broken."""
_HARD_SPACE = "\N{NO-BREAK SPACE}"


def wrapped(text: str, indent: int = 4, first: str | None = None) -> str:
    """Break a text into indented lines of at most 80 characters. A number is never separated from its ± and %.

    first: beginning of the first line in place of the indentation.
    """
    start, rest = " " * indent if first is None else first, " " * indent
    kept = _TOGETHER.sub(_HARD_SPACE, text)
    whole = textwrap.TextWrapper(
        WIDTH, initial_indent=start, subsequent_indent=rest, break_on_hyphens=False, break_long_words=False
    )
    return whole.fill(kept).replace(_HARD_SPACE, " ")


def titled(blocks: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Write blocks of text lines, each below its title; skip a block without lines."""
    return "\n".join(f"[[{title}]]\n" + "\n".join(lines) for title, lines in blocks if lines)


@dataclass(frozen=True)
class Stated:
    """Value ± standard error and unit, as text. deviation: standard error, empty if unknown."""

    value: str
    deviation: str
    unit: str

    def __str__(self) -> str:
        spread = f" ± {self.deviation}" if self.deviation else ""
        return f"{self.value}{spread} {self.unit}".strip()


def prefix(size: float, unit: str) -> tuple[float, str]:
    """Return the factor and the unit that scale a number of magnitude `size` to between 1 and 1000.

    A unit that begins with m or rad gets an SI prefix, any other unit a power of ten.
    `(251e-6, "rad")` gives `(1e6, "µrad")`.
    """
    if not math.isfinite(size) or size <= 0:
        return 1.0, pretty_unit(unit)
    if _LEADING.match(unit):
        step, letter = next((p for p in _PREFIXES if size >= p[0]), _PREFIXES[-1])
        return 1.0 / step, pretty_unit(f"{letter}{unit}")
    power = 3 * math.floor(math.log10(size) / 3) if size < 1e-2 or size >= 1e6 else 0
    if not power:
        return 1.0, pretty_unit(unit)
    ten = f"×10{str(power).translate(_SUPERSCRIPTS)}"
    return 10.0**-power, f"{ten} {pretty_unit(unit)}".strip()


def pretty_unit(unit: str) -> str:
    """Write `rad/Nm` as `rad/(N·m)`, `degC` as `°C`, and the dimensionless unit `1` as an empty text."""
    if unit == "1":
        return ""
    return unit.replace("degC", "°C").replace("degF", "°F").replace("/Nm", "/(N·m)").replace("Nm", "N·m")


def measured(value: float | None, deviation: float | None, unit: str, *, in_list: bool = False) -> Stated:
    """Format a value and its standard error with two digits of the standard error and one SI prefix.

    in_list: True to write all lengths in mm and all angles in mrad, so that the numbers of a list compare.
    """
    if value is None or not math.isfinite(value):
        return Stated(UNKNOWN, "", pretty_unit(unit))
    known = deviation is not None and math.isfinite(deviation) and deviation > 0
    one = unit if in_list else ""
    factor, unit = OF_LISTS.get(one) or prefix(max(abs(value), deviation if known and deviation else 0.0), unit)
    value *= factor
    if not known or deviation is None:
        return Stated(minus(significant(value, 3)), "", unit)
    deviation *= factor
    decimals = min(8, max(0, 1 - math.floor(math.log10(deviation))))
    return Stated(minus(f"{value:.{decimals}f}"), f"{deviation:.{decimals}f}", unit)


def significant(value: float, digits: int) -> str:
    """Write a number with `digits` significant digits; exponents only below 1e-5 and from 1e6 on."""
    if value == 0:
        return "0"
    if not math.isfinite(value):
        return UNKNOWN
    if not 1e-5 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"


def millimetres(value: float | None) -> str:
    """Write a length given in mm: three digits below 0.01 mm, three decimals below 10 mm, else two decimals."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    return significant(value, 3) if abs(value) < 0.01 else f"{value:.{3 if abs(value) < 10 else 2}f}"


def length(mm: float | None) -> str:
    """Write a length given in mm with its unit: mm from 0.02 mm on, else µm."""
    if mm is None or not math.isfinite(mm):
        return UNKNOWN
    return f"{mm:.3f} mm" if mm >= 0.02 else f"{1e3 * mm:.2f} µm"


def change(before: float | None, after: float | None) -> str:
    """Write two lengths given in mm, before and after: `0.260 → 0.091 mm`."""
    return f"{millimetres(before)} → {millimetres(after)} mm"


def counted(poses: int, rows: int, of: str = "") -> str:
    """State the number of poses, and of table rows if a pose has several rows. poses: 0 if each row is a pose."""
    several = 0 < poses < rows
    return f"{poses if several else rows} poses{of and f' of {of}'}{f' in {rows} rows' if several else ''}"


def listed(names: Sequence[str]) -> str:
    """Join names: `a`, `a and b`, `a, b and c`."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def turned(mrad: float, lever: float) -> str:
    """Describe the displacement of a point by a rotation, at a distance `lever`, m, from the flange.

    mrad: rotation in mrad. The text is empty for a lever below 0.5 mm.
    """
    return f": {length(lever * mrad)} at {1e3 * lever:.0f} mm from the flange" if lever > 5e-4 else ""


def some(items: Sequence[object], most: int = 8) -> str:
    """List the first `most` items and the number of further items."""
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(map(str, items[:most])) + more


def ranges(numbers: Sequence[int]) -> list[str]:
    """Write increasing whole numbers, three or more consecutive ones as `3 to 7`."""
    runs = list[list[int]]()
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return [text for run in runs for text in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run))]


def left_out(rows: Sequence[int], of: int) -> str:
    """State the number of excluded measurements and their rows: `1 of 60 readings left out (row 18)`."""
    return f"{len(rows)} of {of} readings left out (row{'s' if len(rows) > 1 else ''} {some(rows)})"


def percent(share: float | None) -> str:
    """Write a share as a percentage without decimals; with one decimal below 1 %."""
    if share is None or not math.isfinite(share):
        return UNKNOWN
    return f"{100 * share:.{1 if 0 < abs(share) < 0.01 else 0}f} %"


def chance(probability: float | None, shuffles: int | None = None, of: str = "permutations") -> str:
    """Write a probability with two digits and the number of permutations from which the probability is estimated.

    A probability below 1 / (permutations + 1) is marked as extrapolated. Below 1e-6 only the bound 1e-6 is stated,
    because the distribution fitted to the tail is not valid there.
    """
    if probability is None or not math.isfinite(probability):
        return UNKNOWN
    said = "< 0.000001" if probability < 1e-6 else f"{probability:.2g}"
    if shuffles is None:
        return said
    beyond = probability < 1.0 / (shuffles + 1)
    return f"{said} {'extrapolated from' if beyond else 'from'} {shuffles} {of}"


def shortened(text: str, length: int) -> str:
    """Cut a text to at most `length` characters, with an ellipsis for the rest."""
    return text if len(text) <= length else f"{text[: length - 1].rstrip()}…"


def short_name(name: str, length: int) -> str:
    """Cut a parameter's name to at most `length` characters and keep its last word, the axis: `shoulder_pan… Tx`."""
    if len(name) <= length or " " not in name:
        return shortened(name, length)
    place, axis = name.rsplit(" ", 1)
    return f"{shortened(place, max(length - len(axis) - 1, 1))} {axis}"


_MINUS = re.compile(r"(?<=\d[eE])-(?=\d)|(?<!\w)-|-(?!\w)")


def minus(text: str) -> str:
    """Replace hyphens with true minus signs; the hyphen between two letters or digits of a name is kept."""
    return _MINUS.sub("\N{MINUS SIGN}", text)


def expression(text: str) -> str:
    """Write an expression for reading: `2*J4**3` as `2·J4³`."""
    text = re.sub(r"\*\*(\d+)", lambda m: m[1].translate(_SUPERSCRIPTS), text)
    text = re.sub(r"(?<=[\w)]) ([+-])(?=[\w(.])", r" \1 ", text)
    return minus(re.sub(r"\s*(?<!\*)\*(?!\*)\s*", "·", text))
