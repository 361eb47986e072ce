"""Test that clusters of neighbouring poses are recognised without a label."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cli_cases import robot
from effect_cases import bare
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.table.blocks import hold_out, repeat_blocks, replicates, sharing
from gpmodel.table.dataset import COVERAGE, Dataset, Specification, specification
from gpmodel.table.units import convert, factor, known_unit, parse_quantity, split_header
from gpmodel.wording import measured

RNG = np.random.default_rng(3)
LOW, HIGH = np.full(6, -2.0), np.full(6, 1.5)


def table(q: Array) -> Dataset:
    return replace(bare("irb6400r", len(q), 3, payload=False), q=q)


def clusters(count: int, size: int, half: float) -> Array:
    """Boxes of a half-width as a share of the range, in no order of their rows."""
    centres = np.repeat(RNG.uniform(LOW, HIGH, (count, 6)), size, axis=0)
    return RNG.permutation(centres + half * (HIGH - LOW) * RNG.uniform(-1, 1, centres.shape))


@pytest.mark.parametrize(("count", "size", "half"), [(12, 10, 0.02), (30, 5, 0.01), (40, 2, 0.005), (8, 20, 0.01)])
def test_clusters_are_bundles_that_no_split_parts(count: int, size: int, half: float) -> None:
    data = table(clusters(count, size, half))
    assert np.bincount(repeat_blocks(data)).tolist() == [size] * count
    assert len(np.unique(sharing(data))) == count
    assert len(np.unique(replicates(data))) == len(data)
    train, heldout = hold_out(data, 0.3, np.random.default_rng(0))
    assert not set(repeat_blocks(data)[train]) & set(repeat_blocks(data)[heldout])


@pytest.mark.parametrize("gap", [0.05, 0.1, 0.15])
def test_two_clusters_that_lie_close_leave_the_others_what_they_are(gap: float) -> None:
    q = clusters(20, 10, 0.02)
    centre = RNG.uniform(LOW, HIGH, 6)
    box = 0.02 * (HIGH - LOW) * RNG.uniform(-1, 1, (2, 10, 6))
    beside = centre + np.array([[[0.0]], [[gap]]]) * (HIGH - LOW) + box
    sizes = np.bincount(repeat_blocks(table(np.vstack([q, *beside]))))
    assert sorted(sizes.tolist()) in ([10] * 22, [10] * 20 + [20])


def sweeps() -> Array:
    """Each joint alone through its range at eight places."""
    return np.vstack(
        [
            np.tile(c, (20, 1)) + np.outer(np.linspace(-1, 1, 20), np.eye(6)[k % 6])
            for k, c in enumerate(RNG.uniform(LOW, HIGH, (8, 6)))
        ]
    )


SCATTERED = {
    "random": RNG.uniform(LOW, HIGH, (80, 6)),
    "few": RNG.uniform(LOW, HIGH, (20, 6)),
    "two joints": RNG.uniform(LOW, HIGH, (90, 6)) * np.array([0, 1, 1, 0, 0, 0]),
    "a walk": np.cumsum(0.1 * RNG.normal(size=(120, 6)), axis=0),
    "a grid": np.stack(np.meshgrid(*[np.linspace(-1, 1, 4)] * 3, [0.0], [0.0], [0.0]), axis=-1).reshape(-1, 6),
    "sweeps": sweeps(),
    "repeats": np.repeat(RNG.uniform(LOW, HIGH, (40, 6)), 3, axis=0) + 1e-5 * RNG.normal(size=(120, 6)),
    "one box": 0.02 * RNG.uniform(LOW, HIGH, (60, 6)),
}


@pytest.mark.parametrize("how", SCATTERED)
def test_other_poses_are_not(how: str) -> None:
    data = table(SCATTERED[how])
    np.testing.assert_array_equal(sharing(data), replicates(data))


def test_a_pose_measured_with_several_payloads_shares_what_no_model_explains() -> None:
    """Each payload is read anew, and whatever the pose has in common is common to all."""
    data = replace(table(SCATTERED["repeats"]), payload=np.tile([0.0, 2.0, 6.0], 40))
    assert len(np.unique(replicates(data))) == 120
    np.testing.assert_array_equal(sharing(data), np.repeat(sharing(data)[::3], 3))
    assert len(np.unique(sharing(data))) == 40


DATA = robot(10, inputs={"temperature": np.arange(10.0)}, input_units={"temperature": "degC"}, payload=np.arange(10.0))[
    1
].dataset


@pytest.mark.parametrize("name", ["q", "position", "rotation", "row", "payload"])
def test_arrays_cannot_be_changed(name: str) -> None:
    with pytest.raises(ValueError, match="read-only"):
        getattr(DATA, name)[0] = 0


@pytest.mark.parametrize("name", ["distances", "labels", "extras", "extra_units"])
def test_mappings_cannot_be_changed(name: str) -> None:
    with pytest.raises(TypeError):
        getattr(DATA, name)["new"] = 0


@pytest.mark.parametrize("rows", [[0, 3, 9], np.array([9, 0]), np.arange(10) % 2 == 0])
def test_subset_takes_the_same_rows_of_everything(rows: Any) -> None:
    part = DATA.subset(rows)
    at = np.arange(10)[rows]
    assert len(part) == len(at)
    np.testing.assert_array_equal(part.row, at + 1)
    np.testing.assert_array_equal(part.q, DATA.q[at])
    np.testing.assert_array_equal(part.position, DATA.position[at])
    np.testing.assert_array_equal(part.payload, at)
    np.testing.assert_array_equal(part.extras["temperature"], at)
    assert part.joints == DATA.joints
    assert part.extra_units == DATA.extra_units


def test_codes_number_labels_in_order_of_appearance() -> None:
    from dataclasses import replace

    labelled = replace(DATA.subset(range(4)), labels={"setup": np.array(["b", "a", "b", ""])})
    names, index = labelled.codes("setup")
    assert names == ["b", "a", ""]
    assert index.tolist() == [0, 1, 0, 2]
    assert DATA.codes("tool") == ([""], pytest.approx(np.zeros(10)))


def test_rotations_are_there_or_not() -> None:
    from dataclasses import replace

    assert not DATA.has_rotation
    assert replace(DATA, rotation=np.zeros((10, 3))).has_rotation


@pytest.mark.parametrize(
    ("text", "offset", "slope"),
    [
        ("15um + 6um/m", 15e-6, 6e-6),
        ("±(15 µm + 6 µm/m)", 15e-6, 6e-6),
        ("10 µm + 5 ppm", 10e-6, 5e-6),
        ("6um/m+15um", 15e-6, 6e-6),
        ("0.02mm", 20e-6, 0.0),
        ("6 um/m", 0.0, 6e-6),
        ("7e+1 um + 1e-3 mm/m", 70e-6, 1e-6),
    ],
)
def test_a_limit_is_an_offset_and_a_slope(text: str, offset: float, slope: float) -> None:
    for said in (text, str(specification(text))):
        found = specification(said)
        assert (found.offset, found.slope) == (pytest.approx(offset), pytest.approx(slope))


@pytest.mark.parametrize(
    "text",
    [
        "15",
        "Leica",
        "",
        "15um - 3um/m",
        "15deg",
        "5um/kg",
        "0 mm",
        "15um +",
        "2m",
        "2 m/m",
        "15um + 6um",
        "3um/m + 2 ppm",
    ],
)
def test_other_text_is_refused_in_one_line_that_says_what_was_expected(text: str) -> None:
    with pytest.raises(InputError) as caught:
        specification(text)
    assert caught.value.argument == "instrument"
    assert "as in '15um + 6um/m'" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_limit_is_that_of_the_typical_distance_of_the_points_that_were_measured() -> None:
    points = np.array([[3.0, 0.0, 0.0], [0.0, -3.0, 0.0], [np.nan, 1.0, 1.0]])
    stated = Specification(15e-6, 6e-6)
    assert stated.at(points) == pytest.approx(33e-6)
    assert stated.noise(points) == pytest.approx(33e-6 / COVERAGE)


FACTORS = [
    ("mm", "length", 1e-3), ("m", "length", 1.0), ("um", "length", 1e-6), ("µm", "length", 1e-6),
    ("in", "length", 0.0254), ("deg", "angle", math.pi / 180), ("rad", "angle", 1.0),
    ("arcsec", "angle", math.pi / 648000), ("kg", "mass", 1.0), ("lb", "mass", 0.45359237), ("g", "mass", 1e-3),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "dimension", "expected"), FACTORS)
def test_factor_is_the_si_value_of_one_unit(unit: str, dimension: str, expected: float) -> None:
    assert factor(unit, dimension, "here") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "dimension"),
    [("kg", "length"), ("mm", "angle"), ("1", "angle"), ("1", "length"), ("deg", "length"), ("", "mass"),
     ("percent", "angle"), ("blorp", "length"), ("mm mm", "length"), ("]", "angle"), ("m(", "length")],
)  # fmt: skip
def test_factor_refuses_what_is_no_unit_of_the_dimension(unit: str, dimension: str) -> None:
    with pytest.raises(InputError, match=r"^column 'a': .* write \["):
        factor(unit, dimension, "column 'a'")


@pytest.mark.parametrize(
    ("header", "expected"),
    [("J1 [deg]", ("J1", "deg")), (" x[mm] ", ("x", "mm")), ("load [ 1 ]", ("load", "1")), ("group", ("group", None)),
     ("a b [N*m]", ("a b", "N*m")), ("t []", ("t", "")), ("odd ] name [s]", ("odd ] name", "s"))],
)  # fmt: skip
def test_header_is_name_and_unit(header: str, expected: tuple[str, str | None]) -> None:
    assert split_header(header) == expected


@pytest.mark.parametrize(
    ("unit", "known"),
    [("degC", True), ("1", True), ("s", True), ("kg*m**2/s^2", True), ("m²", True), ("blorp", False), ("(", False),
     ("deg**9999999999", False), ("9**9**9", False), ("9⁹⁹⁹", False), ("m**9**9", False), ("mm*" * 99, False)],
)  # fmt: skip
def test_known_unit(unit: str, known: bool) -> None:
    assert known_unit(unit) is known


@given(st.floats(-1e6, 1e6).map(lambda v: float(f"{v:.6g}")), st.sampled_from(["", " ", "  "]))
def test_quantity_is_number_times_unit(value: float, space: str) -> None:
    assert parse_quantity(f"{value!r}{space}mm", "length", "here") == pytest.approx(value * 1e-3, rel=1e-12)


@pytest.mark.parametrize("text", ["", "mm", "60", "1.2.3mm", "a few mm", "1e5", "60kg", "--3mm", "nan mm"])
def test_quantity_refuses_what_is_no_length(text: str) -> None:
    with pytest.raises(InputError, match=r"^--noise: "):
        parse_quantity(text, "length", "--noise")


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [("2e-7", "rad/Nm", 2e-7), ("2e-7 rad/Nm", "rad/Nm", 2e-7), ("0.2 urad/Nm", "rad/Nm", 2e-7), ("3", "1", 3.0),
     ("20 arcsec", "rad", 20 * math.pi / 648000), ("0.1 mm", "m", 1e-4), (" -1.5 ", "m", -1.5),
     ("5 mm/N", "m/N", 5e-3), ("4 um/row", "m/row", 4e-6)],
)  # fmt: skip
def test_value_in_the_units_of_an_effect(text: str, unit: str, expected: float) -> None:
    assert convert(text, unit, "here") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("text", "unit"), [("20 kg", "rad"), ("", "m"), ("x", "m"), ("nan", "m"), ("1 blorp", "m")])
def test_value_that_does_not_convert(text: str, unit: str) -> None:
    with pytest.raises(InputError, match=r"^here: "):
        convert(text, unit, "here")


@pytest.mark.parametrize(
    ("value", "stderr", "unit"),
    [
        (4.043e-8, 7.1e-10, "rad/Nm"),
        (-1.5e-3, 2e-5, "m"),
        (1.2e-5, 3e-7, "1/degC"),
        (1.371e-4, 6.4e-6, "rad*kg*m/Nm"),
        (0.25, None, "1"),
    ],
)
def test_what_a_page_prints_is_read_back(value: float, stderr: float | None, unit: str) -> None:
    printed = str(measured(value, stderr, unit))
    assert convert(printed, unit, "value") == pytest.approx(value, rel=1e-2)
