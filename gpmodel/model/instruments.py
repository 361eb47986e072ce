"""Make observations (touches, pixels, inclinations) from the columns of a table."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.branches import carrier_slot
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.described import read_boards, read_cameras, read_surfaces
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation
from gpmodel.model.pixel import FEWEST_CORNERS, Pixels, pixel_size
from gpmodel.model.surfaces import SURFACES
from gpmodel.model.touches import Artefact, Feature, Touches
from gpmodel.numerics import se3
from gpmodel.table.blocks import numbered
from gpmodel.table.dataset import Dataset

KNOWN = "surfaces"
"""Name of the calibration artefact that contains all touched surfaces with a known relative pose."""

SAME_VIEW = 1e-6
"""Largest difference of joint values within one camera view, rad or m: rounding of written digits."""


def with_observations(
    dataset: Dataset, mechanism: Mechanism, described: Mapping[str, Mapping[str, object]] | None = None
) -> Dataset:
    """Return the table with the observations in its columns `on_plane` to `inclination_y`.

    described: descriptions of cameras, boards and surfaces, in place of Dataset.described. Raises InputError for a
    label with too few touches, a camera or marker without a description, or too few corners.
    """
    dataset = dataset if described is None else replace(dataset, described=described)
    found: list[Observation] = [*_touches(dataset), *_pixels(dataset, mechanism), *_inclinations(dataset, mechanism)]
    return replace(dataset, observations=tuple(found))


def _touches(dataset: Dataset) -> Iterator[Touches]:
    fixed, free = read_surfaces(dataset.described.get("surfaces", {}))
    sized = {(f.surface, f.label): f for f in free}
    there = {(f.surface, f.label): k for k, f in enumerate(fixed)}
    body = np.full(len(dataset), -1)
    feature = body.copy()
    for surface in (name for name in ("on_plane", "on_sphere", "on_line") if name in dataset.labels):
        labels = dataset.label(surface)
        known = np.array([there.get((surface, label), -1) for label in labels.tolist()])
        body[known >= 0], feature[known >= 0] = 0, known[known >= 0]
        names = sorted({*labels[(labels != "") & (known < 0)].tolist()})
        bodies = []
        for name in names:
            radius = np.nan if surface == "on_sphere" else 0.0
            only = sized.get((surface, name), Feature(surface, name, radius=radius))
            bodies.append(Artefact(f"{surface} {name}", SURFACES[surface].axes, (only,)))
            _enough(dataset, surface, name, SURFACES[surface].needs + 1)
        if bodies:
            which = np.array([names.index(x) if x in names else -1 for x in labels.tolist()])
            yield Touches(surface, tuple(bodies), which, np.where(which >= 0, 0, -1))
    if (body >= 0).any():
        yield Touches(KNOWN, (Artefact(KNOWN, tuple(range(6)), fixed),), body, feature)
    yield from _points(dataset)
    yield from _bars(dataset)


def _enough(dataset: Dataset, column: str, label: str, needed: int) -> None:
    rows = dataset.row[dataset.label(column) == label]
    if len(rows) < needed:
        count = "one touch" if len(rows) == 1 else f"{len(rows)} touches"
        raise InputError(
            f"{dataset.source}, column '{column}', row {rows[0]}: '{label}' has {count}; expected at least {needed}"
        )


def _points(dataset: Dataset) -> Iterator[Touches]:
    names, which = _codes(dataset, "same_point")
    for name in names:
        _enough(dataset, "same_point", name, 2)
    if names:
        bodies = [Artefact(f"same_point {n}", SURFACES["point"].axes, (Feature("point", n),)) for n in names]
        yield Touches("same_point", tuple(bodies), which, np.where(which >= 0, 0, -1))


def _bars(dataset: Dataset) -> Iterator[Touches]:
    names, which = _codes(dataset, "pair")
    lengths, bodies, end = dataset.readings.get("length"), [], np.full(len(dataset), -1)
    if lengths is not None and len(alone := np.flatnonzero(np.isfinite(lengths) & (which < 0))):
        row = dataset.row[alone[0]]
        raise InputError(f"{dataset.source}, row {row}: a length without a pair; expected a column 'pair'")
    for i, name in enumerate(names):
        rows = np.flatnonzero(which == i)
        where = f"{dataset.source}, column 'pair', row {dataset.row[rows[0]]}: '{name}'"
        if len(rows) != 2:
            raise InputError(f"{where} has {len(rows)} rows; expected two, the ends of one bar")
        given = np.full(2, np.nan) if lengths is None else lengths[rows]
        given = given[np.isfinite(given)]
        if len(given) and np.ptp(given) > 0:
            said = f"{1e3 * given[0]:g} and {1e3 * given[1]:g}"
            raise InputError(f"{where} has two lengths, {said} mm; expected one in 'length [mm]'")
        if not len(given) or given[0] <= 0:
            raise InputError(f"{where} has no length; expected one in 'length [mm]'")
        far = se3.shift([0.0, 0.0, given[0]])
        bodies.append(Artefact(f"pair {name}", SURFACES["end"].axes, (Feature("end", "1"), Feature("end", "2", far))))
        end[rows] = 0, 1
    if bodies:
        yield Touches("pair", tuple(bodies), which, end)


def _pixels(dataset: Dataset, mechanism: Mechanism) -> Iterator[Pixels]:
    if not {"u", "v"} & dataset.readings.keys():
        return
    for name, option in (("cameras", "--cameras"), ("board", "--board")):
        if name not in dataset.described:
            raise InputError(f"{dataset.source}: columns u and v are pixels; expected {option} FILE.toml too")
    values = np.column_stack([dataset.readings.get(c, np.full(len(dataset), np.nan)) for c in "uv"])
    values[~np.isfinite(values).all(axis=1)] = np.nan
    seen = np.isfinite(values[:, 0])
    if not seen.any():
        raise InputError(
            f"{dataset.source}: no row has both u and v; expected columns 'u [px]' and 'v [px]' of numbers"
        )

    def slot(link: str, where: str) -> int:
        return carrier_slot(mechanism, link, where)

    cameras, boards = read_cameras(dataset.described["cameras"], slot), read_boards(dataset.described["board"], slot)
    by_name = {c.name: i for i, c in enumerate(cameras)}
    markers = {m: (i, at) for i, (board, corners) in enumerate(boards) for m, at in _spelled(board.name, corners)}
    camera, board = np.full(len(dataset), -1), np.full(len(dataset), -1)
    corner = np.zeros((len(dataset), 3))
    for row in np.flatnonzero(seen):
        where = f"{dataset.source}, row {dataset.row[row]}"
        for column, known in (("camera", by_name), ("marker", markers)):
            if (text := str(dataset.label(column)[row])) not in known:
                raise InputError(f"{where}: {column} '{text}' is unknown; expected {choices(text, known)}")
        camera[row] = by_name[str(dataset.label("camera")[row])]
        board[row], corner[row] = markers[str(dataset.label("marker")[row])]
    same = np.column_stack([np.round(dataset.q / SAME_VIEW), dataset.codes("setup")[1], dataset.codes("repeat")[1]])
    view = numbered(same)
    flat = np.isin(board, [i for i, (b, _) in enumerate(boards) if b.flat])
    _check_views(dataset, [c.name for c in cameras], view, np.column_stack([np.where(flat, camera, -1), board]))
    used = [np.unique(codes[seen]) for codes in (camera, board)]
    image = numbered(np.column_stack([view, camera, board]))
    yield Pixels(
        values, tuple(cameras[i] for i in used[0]), tuple(boards[i][0] for i in used[1]), _renumbered(camera, used[0]),
        _renumbered(board, used[1]), corner, view, pixel_size(values[seen], corner[seen], image[seen]),
    )  # fmt: skip


def _spelled(board: str, markers: Mapping[str, Array]) -> Iterator[tuple[str, Array]]:
    """Yield each marker of a board by its name, and by the name of the board followed by the name of the marker."""
    for name, at in markers.items():
        yield name, at
        yield f"{board}/{name}", at


def _check_views(dataset: Dataset, cameras: list[str], view: IntArray, which: IntArray) -> None:
    """Raise InputError with the first row of a camera view of a flat board if it shows too few corners."""
    rows = np.flatnonzero(which[:, 0] >= 0)
    keys = np.column_stack([view, which])[rows]
    _, first, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    for at, corners in zip(rows[first], count, strict=True):
        if corners < FEWEST_CORNERS:
            raise InputError(
                f"{dataset.source}, row {dataset.row[at]}: camera '{cameras[which[at, 0]]}' sees {corners} corners in "
                f"one pose; expected at least {FEWEST_CORNERS}"
            )


def _inclinations(dataset: Dataset, mechanism: Mechanism) -> Iterator[Inclination]:
    columns = [dataset.readings.get(f"inclination_{axis}") for axis in "xy"]
    if all(column is None for column in columns):
        return
    values = np.column_stack([np.full(len(dataset), np.nan) if c is None else c for c in columns])
    names, which = _codes(dataset, "link")
    read = np.isfinite(values).any(axis=1)
    if (read & (which < 0)).any():
        row = dataset.row[np.flatnonzero(read & (which < 0))[0]]
        raise InputError(f"{dataset.source}, row {row}: an inclination without a link; expected a column 'link'")
    links = tuple((name, carrier_slot(mechanism, name, f"{dataset.source}, column 'link'")) for name in names)
    if unmoved := [name for name, slot in links if slot < 0]:
        raise InputError(f"{dataset.source}, column 'link': '{unmoved[0]}' does not move; expected a moving link")
    yield Inclination(values, links, np.where(read, which, -1))


def _codes(dataset: Dataset, column: str) -> tuple[list[str], IntArray]:
    """Return the distinct non-empty labels of a column, and the index of each row's label, -1 for an empty label."""
    names, codes = dataset.codes(column)
    kept = {name: i for i, name in enumerate(name for name in names if name)}
    return list(kept), np.array([kept.get(name, -1) for name in names], dtype=np.int64)[codes]


def _renumbered(codes: IntArray, used: IntArray) -> IntArray:
    return np.where(codes >= 0, np.searchsorted(used, codes), -1)
