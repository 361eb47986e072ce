"""Read the joint targets of robot programs, and write other joint values in their places; all other text is kept.

Languages by the suffix of the file: KRL (.src, .dat: aggregates {A1 .., A2 ..}), RAPID (.mod: jointtargets), URScript
(.script, .urscript: movej to a list), Fanuc (.ls: positions in joint representation).
Sources: ABB, Technical reference manual RAPID, jointtarget; KUKA, KSS, E6AXIS; Universal Robots, Script manual, movej;
Fanuc, ASCII upload of TP programs.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.convention import Convention
from gpmodel.table.units import JOINT_UNITS
from gpmodel.texts import read_limited

AXES = 6
"""Number of robot axes in a program; further axes are external axes, E1 to E6."""
AXIS_NAMES = tuple(f"{letter}{k}" for letter in "AE" for k in range(1, AXES + 1))
"""Names of the axes of a jointtarget of RAPID: robot axes, then external axes."""
DECIMALS = 9
"""Number of decimals of a corrected joint value; trailing zeros beyond the decimals of the program are omitted."""
LARGEST_FILE = 32 << 20
"""Largest size of a robot program, bytes: a hundred thousand points."""
MARK = "gpmodel:"
"""First word of the comments that are written into a program."""
CORRECTED_BY = "corrected by gpmodel for "
"""Words of the comment in a program whose joint targets are corrected, upper or lower case."""
NO_AXIS = 8e9
"""Value from which a RAPID program has no external axis: 9E9."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SIX = rf"\[\s*((?:{_NUMBER}\s*,\s*){{5}}{_NUMBER})\s*\]"
_KRL = re.compile(r"\{[^{}\n]*\bA[1-6]\s[^{}\n]*\}")
_FIELD = re.compile(rf"\b(?P<axis>[AE][1-6])\s+(?P<number>{_NUMBER})")
JOINT_TARGET = re.compile(rf"\[\s*{_SIX}\s*,\s*{_SIX}\s*\]")
_MOVEJ = re.compile(r"\b(?:movej|servoj)\s*\(\s*(?P<given>\[[^][\n]*\]|p\[|\w+)")
_LIST = re.compile(_SIX)
_POSITION = re.compile(r"P\[\d+[^\]\n]*\]\s*\{[^{}]*\};?")
_FANUC = re.compile(rf"\b(?P<axis>[JE][1-6])\s*=\s*(?P<number>{_NUMBER})\s*(?P<unit>deg|mm)")
_CARTESIAN = {
    "KRL": re.compile(r"\{[^{}\n]*\bX\s[^{}\n]*\bY\s[^{}\n]*\}"),
    "RAPID": re.compile(r"\[\s*\[(?:[^][,]*,){2}[^][,]*\]\s*,\s*\[(?:[^][,]*,){3}[^][,]*\]\s*,\s*\["),
    "URScript": re.compile(r"\bp\["),
    "Fanuc": re.compile(r"\bX\s*=\s*[-+\d]"),
}
"""Pattern of a Cartesian position by language. Such positions are not corrected."""
_RELATIVE = {
    "KRL": re.compile(r"\bS?PTP_REL\b", re.I),
    "RAPID": re.compile(r"(?!)"),
    "URScript": re.compile(r"\bspeedj\b"),
    "Fanuc": re.compile(r"\bINC\b"),
}
"""Pattern of motions whose joint values are no targets."""
_COMMENT = {"KRL": ";", "RAPID": "!", "URScript": "#", "Fanuc": ""}
_START = {
    "KRL": re.compile(r"^\s*(?:GLOBAL\s+)?DEF(?:DAT|FCT)?\s[^\n]*\n", re.M | re.I),
    "RAPID": re.compile(r"^\s*MODULE\s[^\n]*\n", re.M | re.I),
    "URScript": re.compile(r"^\s*def\s[^\n]*\n", re.M),
}
_SUFFIXES = {".src": "KRL", ".dat": "KRL", ".mod": "RAPID", ".script": "URScript", ".urscript": "URScript",
             ".ls": "Fanuc"}  # fmt: skip


@dataclass(frozen=True)
class Numeral:
    """Number of an axis in the text of a program. start, end: characters. unit: "deg", "rad", "mm", "m" or "" (deg or
    mm by the kind of the joint)."""

    start: int
    end: int
    unit: str = ""


@dataclass(frozen=True)
class RobotProgram:
    """Text of a robot program. points: places of the axes' numbers, A1 to A6 and E1 to E6, for each joint target.

    lines: line of each joint target, from 1. cartesian: number of Cartesian positions.
    """

    name: str
    language: str
    text: str
    points: tuple[Mapping[str, Numeral], ...]
    lines: tuple[int, ...]
    cartesian: int

    @property
    def corrected(self) -> bool:
        """True if a comment states that `compensate` wrote the program; comments of Fanuc's programs do not."""
        return CORRECTED_BY in self.text.lower()

    def number(self, place: Numeral) -> float:
        """Return the number at a place of the text."""
        return float(self.text[place.start : place.end])


def is_program(source: object) -> bool:
    """Return True for the path of a file with the suffix of a robot program."""
    return isinstance(source, str | Path) and Path(source).suffix.lower() in _SUFFIXES


def read_program(path: Path) -> RobotProgram:
    """Read the joint targets of a robot program.

    Raises InputError if the file is missing, has no joint target, or a joint target that is not a list of numbers.
    """
    raw = read_limited(path, LARGEST_FILE, "a robot program")
    text = raw.decode("utf-8", "surrogateescape")
    language = _SUFFIXES[path.suffix.lower()]
    code = _without_comments(text, language)
    reader = {"KRL": _krl, "RAPID": _rapid, "URScript": _urscript, "Fanuc": _fanuc}[language]
    if relative := _RELATIVE[language].search(code):
        line = code.count("\n", 0, relative.start()) + 1
        raise InputError(f"{path.name}, line {line}: {relative[0]!r} is a relative motion; expected joint targets")
    points = dict(sorted(reader(code, path.name)))
    if not points:
        raise InputError(f"{path.name}: no joint target of {language}; expected {_EXAMPLES[language]}")
    lines = tuple(code.count("\n", 0, start) + 1 for start in points)
    cartesian = len(_CARTESIAN[language].findall(code))
    return RobotProgram(path.name, language, text, tuple(points.values()), lines, cartesian)


_EXAMPLES = {
    "KRL": "{A1 0, A2 -90, A3 90, A4 0, A5 0, A6 0}",
    "RAPID": "a jointtarget [[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]",
    "URScript": "movej([0, 0, 0, 0, 0, 0])",
    "Fanuc": "P[1]{ ... J1 = 0 deg, ... J6 = 0 deg };",
}


def _without_comments(text: str, language: str) -> str:
    """Replace the comments of a program by blanks, so that places of the text are unchanged."""
    sign = _COMMENT[language]
    if not sign:
        return text
    return re.sub(rf'("[^"\n]*")|{sign}[^\n]*', lambda m: m[1] or " " * len(m[0]), text)


def _krl(code: str, name: str) -> Iterator[tuple[int, dict[str, Numeral]]]:
    for found in _KRL.finditer(code):
        fields = {m["axis"]: Numeral(found.start() + m.start("number"), found.start() + m.end("number"))
                  for m in _FIELD.finditer(found[0])}  # fmt: skip
        if not fields.keys() >= {f"A{k}" for k in range(1, AXES + 1)}:
            line = code.count("\n", 0, found.start()) + 1
            raise InputError(f"{name}, line {line}: {found[0][:60]!r} is no number for every axis; expected A1 to A6")
        yield found.start(), fields


def _six(found: re.Match[str], group: int, letter: str, unit: str) -> dict[str, Numeral]:
    numbers = re.finditer(_NUMBER, found[group])
    first = found.start(group)
    return {f"{letter}{k}": Numeral(first + m.start(), first + m.end(), unit) for k, m in enumerate(numbers, 1)}


def _rapid(code: str, name: str) -> Iterator[tuple[int, dict[str, Numeral]]]:
    for found in JOINT_TARGET.finditer(code):
        outside = {axis: p for axis, p in _six(found, 2, "E", "").items() if float(code[p.start : p.end]) < NO_AXIS}
        yield found.start(), _six(found, 1, "A", "") | outside


def _urscript(code: str, name: str) -> Iterator[tuple[int, dict[str, Numeral]]]:
    for move in _MOVEJ.finditer(code):
        given, starts = move["given"], [move.start("given")]
        if given[0] != "[":
            value = rf"(?<![\w.]){given}\s*=\s*"
            if given == "p[" or re.search(value + r"p\[", code):
                continue
            starts = [m.end() for m in re.finditer(value + r"(?=\[)", code)]
        lists = [found for start in starts if (found := _LIST.match(code, start))]
        if not lists or len(lists) < len(starts):
            line = code.count("\n", 0, move.start()) + 1
            raise InputError(f"{name}, line {line}: {move[0][:60]!r} is no list of six numbers; expected one, in rad")
        yield from ((found.start(), _six(found, 1, "A", "rad")) for found in lists)


def _fanuc(code: str, name: str) -> Iterator[tuple[int, dict[str, Numeral]]]:
    """Yield the positions of motion group 1 in joint representation; other groups keep their values."""
    for position in _POSITION.finditer(code):
        first = position.start()
        fields = {
            m["axis"].replace("J", "A"): Numeral(first + m.start("number"), first + m.end("number"), m["unit"])
            for m in _FANUC.finditer(position[0].partition("GP2")[0])
        }
        if "A1" in fields:
            yield position.start(), fields


def fields_of(mechanism: Mechanism, convention: Convention | None) -> tuple[str, ...]:
    """Return the field of a program, A1 to A6 or E1 to E6, of each joint of a mechanism, or axis of its controller.

    Names such as E1 are external axes. Robot axes go by the numbers at the ends of their names, else by their order.
    Of more than six unnamed joints, six that turn are robot axes, and those that slide are external axes. Raises
    InputError for other mechanisms.
    """
    names = [j.name for j in mechanism.joints] if convention is None else list(convention.axes)
    outside = {k: f"E{found[1]}" for k, n in enumerate(names) if (found := re.fullmatch(r"[Ee](?:xt|ax)?_?([1-6])", n))}
    robot = [k for k in range(len(names)) if k not in outside]
    if len(robot) > AXES and not outside:
        slides = [k for k in robot if mechanism.joints[k].kind == "prismatic"]
        outside = {k: f"E{i}" for i, k in enumerate(slides, 1)}
        robot = [k for k in robot if k not in outside]
    if len(robot) > AXES or len(outside) > AXES:
        raise InputError(
            f"{mechanism.name}: {len(robot)} joints; expected at most {AXES} robot axes in a program, and external "
            "axes named E1, E2, ..."
        )
    ends = [re.search(r"(?<!\d)([1-6])$", names[k]) for k in robot]
    numbers = [int(end[1]) for end in ends if end]
    numbers = numbers if len(set(numbers)) == len(robot) else list(range(1, len(robot) + 1))
    places = outside | {k: f"A{number}" for k, number in zip(robot, numbers, strict=True)}
    return tuple(places[k] for k in range(len(names)))


def _scale(place: Numeral, kind: str, where: str) -> float:
    """Return the number of rad or m in one unit of a program's number."""
    known = {"revolute": {"deg": np.pi / 180.0, "rad": 1.0}, "prismatic": {"mm": 1e-3, "m": 1.0}}[kind]
    unit = place.unit or ("deg" if kind == "revolute" else "mm")
    unit = "m" if kind == "prismatic" and unit == "rad" else unit
    if unit not in known:
        raise InputError(f"{where} is in {unit}; expected {' or '.join(known)}, because the joint is {kind}")
    return float(known[unit])


def joint_values(program: RobotProgram, mechanism: Mechanism, convention: Convention | None) -> Array:
    """Return joint values (targets, n) of the description, rad or m, from the joint targets of a program.

    Other external axes are ignored. Raises InputError naming the line if a target lacks an axis of the mechanism, or
    moves a robot axis that the mechanism does not have.
    """
    fields = fields_of(mechanism, convention)
    values = np.zeros((len(program.points), len(fields)))
    for k, (point, line) in enumerate(zip(program.points, program.lines, strict=True)):
        where = f"{program.name}, line {line}"
        for i, (field, joint) in enumerate(zip(fields, mechanism.joints, strict=True)):
            if field not in point:
                raise InputError(f"{where}: no {field}, the axis of joint '{joint.name}'; expected {', '.join(fields)}")
            values[k, i] = program.number(point[field]) * _scale(point[field], joint.kind, f"{where}: {field}")
        other = [a for a in point if a not in fields and a.startswith("A") and program.number(point[a])]
        if other:
            moved = f"{other[0]} is {program.number(point[other[0]]):g}"
            raise InputError(f"{where}: {moved}; expected 0, because {mechanism.name} has no such joint")
    return values if convention is None else convention.of_description(values)


def program_frame(program: RobotProgram, mechanism: Mechanism, convention: Convention | None) -> pd.DataFrame:
    """Return the joint targets of a program as text cells of a table: line and joint values of the description."""
    q = joint_values(program, mechanism, convention)
    columns = {
        f"{joint.name} [{JOINT_UNITS[joint.kind]}]": [repr(v) for v in values.tolist()]
        for joint, values in zip(mechanism.joints, q.T, strict=True)
    }
    return pd.DataFrame({"line [1]": [str(line) for line in program.lines]} | columns, dtype=object)


def rewritten(
    program: RobotProgram, mechanism: Mechanism, q: Array, convention: Convention | None, notes: Sequence[str]
) -> str:
    """Return the text of a program with other joint values q (targets, n) of the description, rad or m.

    notes: comments below the first line, in the languages that allow them.
    """
    values = q if convention is None else convention.of_controller(q)
    fields = fields_of(mechanism, convention)
    changes = dict[Numeral, str]()
    for point, row in zip(program.points, values.tolist(), strict=True):
        for field, joint, value in zip(fields, mechanism.joints, row, strict=True):
            place = point[field]
            number = value / _scale(place, joint.kind, field)
            changes[place] = _written(number, program.text[place.start : place.end])
    text, end = [], 0
    for place in sorted(changes, key=lambda p: p.start):
        text += [program.text[end : place.start], changes[place]]
        end = place.end
    return _with_notes("".join([*text, program.text[end:]]), program.language, notes)


def _written(number: float, before: str) -> str:
    """Write a number with at least the decimals of the number before; the number before if both are equal."""
    if round(number, DECIMALS) == round(float(before), DECIMALS):
        return before
    digits = len(before.partition(".")[2]) if "e" not in before.lower() else 0
    whole, _, decimals = f"{number:.{DECIMALS}f}".partition(".")
    kept = decimals.rstrip("0").ljust(max(1, min(digits, DECIMALS)), "0")
    return f"{'+' * (before[0] == '+' and number > 0)}{whole}.{kept}"


def _with_notes(text: str, language: str, notes: Sequence[str]) -> str:
    """Add comments below the first line of a program."""
    sign = _COMMENT[language]
    if not sign:
        return text
    end = "\r\n" if "\r\n" in text else "\n"
    start = _START[language].search(text)
    place = start.end() if start else 0
    said = "".join(f"{sign} {MARK} {note}{end}" for note in notes).encode("ascii", "replace").decode()
    return f"{text[:place]}{said}{text[place:]}"
