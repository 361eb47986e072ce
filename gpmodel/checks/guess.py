"""Assign the columns of a foreign file to a mechanism, and list every doubt about the assignment."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice, product
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.checks.assign import SI_UNIT, Assigner, Columns, Fit, header_of, role_of, si_of, sign_doubts, windows
from gpmodel.checks.mixed_up import COARSE, FAR_BETTER, FEWEST_ROWS, PROPER, TAIT_BRYAN, rotation_misfit
from gpmodel.checks.notes import POOR_LENGTH, flange
from gpmodel.checks.rounding import ENOUGH, FINEST, rounding
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import LABELS, unmeasured
from gpmodel.table.foreign import FAR_FROM_ONE, ColumnMap, OrientationColumns, find, orientation_reader
from gpmodel.table.join import COMMON, ORDER, joined, read_files, rows_side_by_side, sheets_of, ways
from gpmodel.table.layout import Sheet
from gpmodel.table.units import identifier, known_unit

APART = 2e-3
"""Least distance between the tool points of two reflectors or set-ups, m, that count as different tools."""
COARSEST = 1e-4
"""Largest rounding of positions, m, that is smaller than the errors of any uncalibrated arm."""
MOST_LABELS = 12
"""Largest number of different values of a table column that names tools or set-ups."""
COMPUTED_TURN = 1e-5
"""Least angle, rad, between measured and nominal orientations. With a smaller angle, orientations were computed."""
CONVENTIONS = (
    "rotation vector",
    *(f"{kind} {axes.upper()}" for kind, axes in product(("intrinsic", "fixed"), (*TAIT_BRYAN, *PROPER))),
)


@dataclass(frozen=True)
class Guess:
    """Assignment of a file's columns. map: assigned columns. lines: text per column. doubts: questions to the user."""

    map: ColumnMap
    lines: tuple[str, ...]
    doubts: tuple[str, ...]


def guess_files(paths: Sequence[Path], mechanism: Mechanism, join: str | None) -> tuple[Sheet, Guess]:
    """Read one file, or join two files in the first way that fits, and assign the columns; raise InputError if none
    fit."""
    sheets = sheets_of(paths)
    if len(sheets) == 1 or join:
        sheet = read_files(paths, join or "")
        return sheet, _guess_as(sheet, mechanism, join or "")
    first, second = sheets
    alone = ("",) if len(paths) == 1 else ()
    refused: InputError | None = None
    for how in chain(alone, ways(first, second), _by_pose(first, second, mechanism)):
        try:
            sheet = joined(first, second, how) if how else first
            found = guess(sheet, mechanism)
            return sheet, replace(found, map=replace(found.map, join=how))
        except InputError as error:
            refused = error
    for how in islice(ways(first, second), 1):
        sheet = joined(first, second, how)
        with suppress(InputError):
            return sheet, _guess_as(sheet, mechanism, how)
    message = f"{first.source} and {second.source}: no common column, no times, and not as many rows"
    raise refused or InputError(f"{message}; expected --join with a column of each")


def _guess_as(sheet: Sheet, mechanism: Mechanism, join: str) -> Guess:
    """Assign columns to joints and points, if necessary with changed joint zeros and signs."""
    try:
        found = guess(sheet, mechanism)
    except InputError:
        turned: Guess | None = None
        with suppress(InputError):
            turned = guess(sheet, mechanism, turned=True)
        if turned is None:
            raise
        found = turned
    return replace(found, map=replace(found.map, join=join))


def _by_pose(first: Sheet, second: Sheet, mechanism: Mechanism) -> Iterator[str]:
    """Yield joins of joint rows to the nearest positions, with the registration from a third of the rows."""
    for one, other in ((first, second), (second, first)):
        third = min(len(one.cells), len(other.cells)) // 3
        for part in (slice(None, third), slice(-third, None)):
            fits = (
                Assigner(joined(one.part(part), other.part(part), ORDER), mechanism).fits()
                if third >= FEWEST_ROWS
                else []
            )
            if not fits or max(fits[0].joints) >= len(one.names) or min(fits[0].points) < len(one.names):
                continue
            fit = min(fits, key=lambda fit: fit.left)
            q = np.column_stack(
                [
                    si_of(u, j.kind) * numbers_of(one, i)
                    for i, u, j in zip(fit.joints, fit.units, mechanism.joints, strict=True)
                ]
            )
            q = q if fit.turned is None else np.column_stack([q, np.ones(len(q))]) @ fit.turned.T
            p = si_of(fit.unit, "prismatic") * np.column_stack(
                [numbers_of(other, i - len(one.names)) for i in fit.points]
            )
            apart = np.linalg.norm(fit.found.points(flange(mechanism, q))[:, None] - p, axis=2)
            near = apart.argmin(axis=0)
            mutual = (apart.argmin(axis=1)[near] == np.arange(len(p))) & (
                apart.min(axis=0) < FAR_BETTER * max(fit.left, APART)
            )
            if mutual.mean() > COMMON:
                pairs = np.column_stack([near[mutual], np.flatnonzero(mutual)])
                yield rows_side_by_side(pairs if one is first else pairs[:, ::-1])


def guess(sheet: Sheet, mechanism: Mechanism, turned: bool = False) -> Guess:
    """Assign the columns of a sheet by their names and by the residual of a registration.

    turned: True to try other zeros, signs and couplings of several joints. Raises InputError if no assignment fits the
    mechanism, or if the positions are computed and not measured.
    """
    label, fits = _fits(sheet, mechanism, turned)
    if not fits:
        raise InputError(_nothing(sheet, mechanism))
    doubts: list[str] = []
    lines: dict[int, str] = {}
    fits = _one_set_of_joints(sheet, fits, doubts, lines)
    fits = _measured(sheet, mechanism, fits, lines)
    tools = _reflectors(sheet, fits, doubts, lines)
    best = fits[0]
    columns = {**_joints(sheet, mechanism, best, doubts, lines)}
    points = [_point(sheet, fit, doubts, lines) for fit in tools]
    columns |= points[0] if len(points) == 1 else {}
    if label is not None:
        column, roles = label
        columns |= dict.fromkeys(roles, f"c{column + 1}")
        lines[column] = f"{' and '.join(roles)}: rows with different values have different registrations"
    orientation = _orientation(sheet, mechanism, best, lines)
    columns |= _inputs(sheet, lines, columns)
    text = [f"{i + 1:3} {name or '(no name)'}: {lines.get(i, 'left out')}" for i, name in enumerate(sheet.names)]
    several = {str(k + 1): point for k, point in enumerate(points)} if len(points) > 1 else {}
    return Guess(ColumnMap(columns, orientation, "guess", several, any(sheet.names)), tuple(text), tuple(doubts))


def _fits(sheet: Sheet, mechanism: Mechanism, turned: bool) -> tuple[tuple[int, tuple[str, ...]] | None, list[Fit]]:
    """Return assignments of columns that fit all rows; else one for each value of a label column, and the column."""
    if fits := Assigner(sheet, mechanism).fits():
        return None, fits
    if turned:
        return None, Assigner(sheet, mechanism).turned()
    for column in sheet.columns:
        text = sheet.cells[column].fillna("")
        values = text.value_counts()
        if not 1 < len(values) <= MOST_LABELS or values.min() < FEWEST_ROWS:
            continue
        parts = [Assigner(sheet, mechanism, np.flatnonzero(text == value)).fits() for value in values.index]
        alike = [
            part[0]
            for part in parts
            if part and part[0].joints == parts[0][0].joints and part[0].points == parts[0][0].points
        ]
        if len(alike) == len(values):
            one = alike[0].found
            moved = any(
                np.linalg.norm(f.found.turn @ p + f.found.shift - one.turn @ p - one.shift) > APART
                for f in alike
                for p in np.eye(3)
            )
            other = any(np.linalg.norm(fit.found.tool - one.tool) > APART for fit in alike)
            return (column, ("setup",) * moved + ("tool",) * (other or not moved)), alike[:1]
    return None, []


def _nothing(sheet: Sheet, mechanism: Mechanism) -> str:
    """Describe why no assignment of the columns to joints and points fits."""
    count, names = len(mechanism.joints), ", ".join(joint.name for joint in mechanism.joints)
    numbers = sum(sheet.numbers(i) is not None for i in sheet.columns)
    if numbers < count + 3:
        return (
            f"{sheet.source}: {numbers} columns of numbers; expected {count} joint values ({names}) and x, y, z a row"
        )
    if len(sheet.cells) < FEWEST_ROWS:
        return (
            f"{sheet.source}: {len(sheet.cells)} rows; expected at least {FEWEST_ROWS} to identify the "
            "columns, or --map"
        )
    return (
        f"{sheet.source}: no {count} columns as joint values ({names}) and 3 as positions fit {mechanism.name} by any "
        "unit, sign or coupling; expected measured positions of this mechanism, a row a pose, or --map MAP.toml"
    )


def _one_set_of_joints(sheet: Sheet, fits: list[Fit], doubts: list[str], lines: dict[int, str]) -> list[Fit]:
    """Return the fits of one set of joint columns: the measured set, if names distinguish measured from commanded."""
    best = min(fits, key=lambda fit: fit.left)
    fits = [fit for fit in fits if fit.left < max(FAR_BETTER * best.left, APART)]
    sets = list(dict.fromkeys(fit.joints for fit in fits))
    names = [column or str(i + 1) for i, column in enumerate(sheet.names)]
    said = {joints: role_of(names, joints) for joints in sets}
    first = max(sets, key=lambda joints: said[joints])
    for other in sets:
        if other != first:
            shown = [" to ".join(names[i] for i in (s[0], s[-1])) for s in (first, other)]
            alike = all(sheet.cells[a].equals(sheet.cells[b]) for a, b in zip(first, other, strict=True))
            if not alike and said[first] == said[other]:
                doubts.append(f"joint values are in {shown[0]} and in {shown[1]}; expected the encoder values only")
            lines |= {i: f"left out: {shown[0]} are used as joint values" for i in other if i not in first}
    return sorted((fit for fit in fits if fit.joints == first), key=lambda fit: fit.points)


def _measured(sheet: Sheet, mechanism: Mechanism, fits: list[Fit], lines: dict[int, str]) -> list[Fit]:
    """Return fits whose points were not computed from joint values; raise InputError if all were computed."""
    left = []
    for fit in fits:
        if _computed(mechanism, fit):
            lines |= dict.fromkeys(fit.points, "left out: computed by the controller, not measured")
        else:
            left.append(fit)
    if not left:
        names = ", ".join(sheet.names[i] or f"column {i + 1}" for i in fits[0].points)
        raise InputError(
            f"{sheet.source}: the positions {names} are computed by the controller from the joint values: the "
            f"residual of the standard model is below {1e6 * FINEST:g} um; expected positions of an instrument"
        )
    return left


def _computed(mechanism: Mechanism, fit: Fit) -> bool:
    """Return whether positions were computed from joint values: the residual is as small as the rounding of the digits.

    Positions also count as computed if the residual of the standard model is below the noise of every instrument.
    """
    data = replace(unmeasured([joint.name for joint in mechanism.joints], fit.q), position=fit.position)
    if fit.left < max(FINEST, min(ENOUGH * rounding(data), COARSEST)):
        return True
    effects = geometric_effects(mechanism)
    if 2 * fit.position.size < 3 * len(effects) + 18:
        return False
    return root_mean_square(calibrate(ErrorModel(mechanism, effects), prepare(mechanism, data)).fitted_error) < FINEST


def numbers_of(sheet: Sheet, column: int) -> Array:
    """Return the values of a numeric column of a sheet, one per row."""
    values = sheet.numbers(column)
    assert values is not None
    return np.asarray(values, dtype=np.float64)


def _reflectors(sheet: Sheet, fits: list[Fit], doubts: list[str], lines: dict[int, str]) -> list[Fit]:
    """Return one fit for each tool point, preferably with columns named as measured."""
    taken: list[Fit] = []
    said = {fit.points: role_of(sheet.names, fit.points) for fit in fits}
    for fit in sorted(fits, key=lambda f: (-said[f.points], f.points)):
        if said[fit.points] < 0 <= max(said.values()):
            lines |= dict.fromkeys(fit.points, "left out: nominal by its name; another point is measured")
            continue
        same = next((f for f in taken if np.linalg.norm(f.found.tool - fit.found.tool) < APART), None)
        shared = any(set(f.points) & set(fit.points) for f in taken)
        if same is None and not shared:
            taken.append(fit)
            continue
        if same is not None and not shared:
            shown = [" ".join(sheet.names[i] or f"column {i + 1}" for i in f.points) for f in (same, fit)]
            if said[same.points] == said[fit.points] and not _congruent(sheet, same, fit):
                doubts.append(f"positions are in {shown[0]} and in {shown[1]}; expected the measured positions only")
        lines |= {i: "left out: the positions are taken from other columns" for i in fit.points if not shared}
    return sorted(taken, key=lambda f: f.points)


def _congruent(sheet: Sheet, one: Fit, other: Fit) -> bool:
    """Return True if the points of two fits are congruent: one set of points in two frames."""
    a, b = (
        np.column_stack([numbers_of(sheet, i) for i in f.points]) * si_of(f.unit, "prismatic") for f in (one, other)
    )
    known = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    apart = [np.linalg.norm(p[known] - p[known][:1], axis=1) for p in (a, b)]
    return bool(np.abs(apart[0] - apart[1]).max() < FINEST)


def _ref(sheet: Sheet, column: int, unit: str) -> str:
    """Return the entry for a file's column in a column map: the column's name if unique, else its number."""
    name, own, sure = header_of(sheet, column)
    plain = name.replace("_", "").replace(" ", "").isalnum() and not name[:1].isdigit() and not (sure and own != unit)
    return f"{name if plain and find(sheet, name) == column else f'c{column + 1}'} [{unit}]".replace(" []", "")


def _joints(sheet: Sheet, mechanism: Mechanism, fit: Fit, doubts: list[str], lines: dict[int, str]) -> dict[str, str]:
    """Return the entries of the column map (table column -> file column) for the joints."""
    out: dict[str, str] = {}
    turned = np.eye(len(fit.joints), len(fit.joints) + 1) if fit.turned is None else fit.turned
    if "swapped" in fit.reading:
        doubts.append(f"{fit.reading}, which contradicts the names; expected corrected names in the file")
    for joint, row, unit, column in zip(mechanism.joints, turned, fit.units, fit.joints, strict=True):
        if row.tolist() == np.eye(len(row))[len(out)].tolist():
            out[joint.name] = _ref(sheet, column, unit)
        else:
            terms = [(c, f"c{i + 1}") for i, c in zip(fit.joints, row.tolist(), strict=False) if c]
            zero = float(row[-1]) / si_of(unit, joint.kind)
            terms += [(zero, f"{abs(zero):.10g}")] * bool(zero)
            text = " ".join(f"{'-' if c < 0 else '+'} {term}" for c, term in terms)
            out[joint.name] = f"{text.removeprefix('+ ').replace('- ', '0 - ', text.startswith('- '))} [{unit}]"
        _, own, sure = header_of(sheet, column)
        if sure and own != unit and si_of(own, joint.kind):
            doubts.append(f"'{sheet.names[column]}' fits as [{unit}], but the header has [{own}]")
        lines[column] = f"{joint.name} [{unit}]" + f", read as {out[joint.name]}" * (
            out[joint.name] != _ref(sheet, column, unit)
        )
    if fit.reading:
        lines[fit.joints[0]] += f"; {fit.reading}"
    doubts += sign_doubts(mechanism, fit)
    if fit.left > POOR_LENGTH:
        doubts.append(f"after registration and tool {1e3 * fit.left:.3g} mm remain, more than the error of an arm")
    return out


def _point(sheet: Sheet, fit: Fit, doubts: list[str], lines: dict[int, str]) -> dict[str, str]:
    """Return the entries of the column map (table column -> file column) for one measured point."""
    for axis, column in zip("xyz", fit.points, strict=True):
        _, own, sure = header_of(sheet, column)
        lines[column] = f"{axis} [{fit.unit}]"
        if sure and own != fit.unit and si_of(own, "prismatic"):
            doubts.append(f"'{sheet.names[column]}' fits as [{fit.unit}], but the header has [{own}]")
    lines[fit.points[0]] += (
        f"; residual after registration {1e3 * fit.left:.3g} mm, tool point "
        f"{np.round(1e3 * fit.found.tool, 1).tolist()} mm"
    )
    return {axis: _ref(sheet, column, fit.unit) for axis, column in zip("xyz", fit.points, strict=True)}


def _orientation(sheet: Sheet, mechanism: Mechanism, fit: Fit, lines: dict[int, str]) -> OrientationColumns | None:
    """Return the columns of orientations that fit the mechanism, with their convention, or None."""
    turned = fit.found.turn @ flange(mechanism, fit.q)[:, :3, :3]
    free = [i for i in sheet.columns if i not in lines and sheet.numbers(i) is not None]
    found = []
    for count in (4, 3):
        for columns in windows(free, count):
            found += list(_conventions(sheet, columns, fit.rows, turned))
        if found:
            break
    if not found:
        return None
    left, convention, unit, columns = min(found, key=lambda item: (round(item[0], 6), item[1] != "rotation vector"))
    if left < COMPUTED_TURN or lines.get(columns[0] - 1, "").startswith("left out: computed"):
        lines |= dict.fromkeys(columns, "left out: orientation computed by the controller, not measured")
        return None
    lines |= dict.fromkeys(
        columns, f"orientation, {convention} {unit}; deviation from the mechanism {1e3 * left:.2g} mrad"
    )
    return OrientationColumns(tuple(_ref(sheet, i, unit) for i in columns), convention)


def _conventions(
    sheet: Sheet, columns: Columns, rows: IntArray, turned: Array
) -> Iterator[tuple[float, str, str, Columns]]:
    """Yield orientation conventions in which columns fit: median angle error, rad, convention, unit, columns."""
    numbers = np.column_stack([numbers_of(sheet, i)[rows] for i in columns])
    whole = np.isfinite(numbers).all(axis=1)
    if whole.sum() < FEWEST_ROWS:
        return
    numbers, turned = numbers[whole], turned[whole]
    if len(columns) == 4:
        if np.abs(np.linalg.norm(numbers, axis=1) - 1.0).max() > FAR_FROM_ONE:
            return
        tried = [(convention, "", 1.0) for convention in ("quaternion xyzw", "quaternion wxyz")]
    else:
        tried = [(c, unit, si_of(unit, "revolute")) for unit in ("deg", "rad") for c in CONVENTIONS]
    for convention, unit, size in tried:
        reader, _ = orientation_reader(convention, "")
        if (left := rotation_misfit(turned, reader(size * numbers).as_matrix())) < COARSE:
            yield left, convention, unit, columns


def _inputs(sheet: Sheet, lines: dict[int, str], taken: dict[str, str]) -> dict[str, str]:
    """Return the map entries of labels, times, payload and inputs of a known unit other than a length or an angle."""
    out: dict[str, str] = {}
    for i in sheet.columns:
        if i in lines:
            continue
        name, unit, _ = header_of(sheet, i)
        values, word = sheet.numbers(i), identifier(name)
        if name.lower() in LABELS and name.lower() not in taken:
            out[name.lower()], lines[i] = f"c{i + 1}", f"label {name.lower()}"
        elif sheet.seconds(i) is not None and "time" not in out:
            out["time"], lines[i] = f"c{i + 1} [s]", "input time [s]"
        elif values is None:
            lines[i] = "left out: text" if sheet.cells[i].notna().any() else "left out: empty"
        elif values.isna().any() or values.nunique() < 2:
            lines[i] = "left out: constant" if values.nunique() < 2 else "left out: not in every row"
        elif unit is None or not known_unit(unit) or any(si_of(unit, kind) for kind in SI_UNIT):
            lines[i] = "left out: no unit" if unit is None else f"left out: a measurement in {unit} that no model needs"
        elif word not in out and word not in taken:
            out[word], lines[i] = _ref(sheet, i, unit), f"input {word} [{unit}]"
    return out
