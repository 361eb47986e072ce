"""The error budget and the contact types: numbers, shares, files, refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from spherical_cases import JOINT

from gpmodel.errors import InputError
from joints.budget import ErrorSource, budget_joint, error_budget, read_budget
from joints.contact_types import contact_types
from joints.settings import DATA


def budget(*sources: ErrorSource, seed: int = 0, poses: int = 100, draws: int = 1000):
    return error_budget(JOINT, sources, "systematic", np.random.default_rng(seed), poses, draws)


def source(index: int, half_range: float, distribution: str = "normal") -> ErrorSource:
    return ErrorSource(index, half_range, "systematic", distribution, "test")


def test_three_equal_offsets_give_a_maxwell_distribution() -> None:
    """|e| of three normal components of sigma 1 um: mean 2 sqrt(2/pi), variance 3 - 8/pi. Source: Maxwell."""
    found = budget(*(source(i, 3e-6) for i in (13, 14, 15)))
    mean = 2e-6 * np.sqrt(2 / np.pi)
    assert found.mean == pytest.approx(mean, rel=0.01)
    assert found.worst_case == pytest.approx(mean + 3e-6 * np.sqrt(3 - 8 / np.pi), rel=0.01)
    np.testing.assert_allclose(found.shares, 1 / 3, atol=1e-12)


def test_a_rotation_counts_by_its_lever() -> None:
    """The mean square is four times as large at twice the lever; an offset does not change."""
    sources = source(12, 3e-4), source(14, 3e-6)
    twice = replace(JOINT, tooling_ball=tuple(2 * v for v in JOINT.tooling_ball))
    short, long = (
        error_budget(joint, sources, "systematic", np.random.default_rng(0)).shares for joint in (JOINT, twice)
    )
    assert long[0] / long[1] == pytest.approx(4 * short[0] / short[1])
    assert sum(short) == pytest.approx(1.0)


def test_uniform_and_normal_differ_by_their_deviation_only_in_the_mean_square() -> None:
    flat, bell = budget(source(14, 3e-6, "uniform")), budget(source(14, 3e-6))
    assert np.sqrt(np.mean(flat.distances**2)) == pytest.approx(3e-6 / np.sqrt(3), rel=0.02)
    assert np.sqrt(np.mean(bell.distances**2)) == pytest.approx(1e-6, rel=0.02)
    assert flat.distances.max() <= 3e-6 + 1e-15


def test_the_same_seed_gives_the_same_budget_and_its_histogram_counts_every_draw() -> None:
    first, again = budget(source(14, 3e-6), draws=100), budget(source(14, 3e-6), draws=100)
    np.testing.assert_array_equal(first.distances, again.distances)
    shares, edges = first.histogram(20)
    assert shares.sum() == pytest.approx(1.0)
    assert len(edges) == 21


def test_the_shipped_budget_comes_near_the_published_totals() -> None:
    """Figures 3.18 and 3.19: 0.1 um repeatability, 10 um accuracy, for ranges chosen to that end."""
    sources, settings = read_budget()
    for kind, published in (("stochastic", 0.1e-6), ("systematic", 10e-6)):
        found = error_budget(JOINT, sources, kind, np.random.default_rng(0), settings["poses"], settings["draws"])
        assert found.distances.shape == (100, 1000)
        assert found.worst_case == pytest.approx(published, rel=0.1)


ENTRY = 'range = "1 um"\nkind = "systematic"\ndistribution = "normal"\nsource = "x"\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"[[translation]]\nindex = 31\n{ENTRY}", "index 31; expected 1 to 30"),
        (f"[[translation]]\nindex = 12\n{ENTRY}", "index 12 is 12 Rz Ts_Tbr"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("1 um", "-1 um"), "0 or more"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("1 um", "1"), "quantity with its unit"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("normal", "bell"), "uniform or normal"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("systematic", "both"), "systematic or stochastic"),
        ("[[translation]]\nindex = 14\n", "has no 'range'"),
        ("spin = 1\n", "unknown key 'spin'"),
    ],
)
def test_a_bad_budget_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "budget.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_budget(path)
    assert "\n" not in str(caught.value)


def test_a_budget_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="0 systematic sources"):
        error_budget(JOINT, (), "systematic", np.random.default_rng(0))


def test_contact_types_hold_the_figures_the_text_prints() -> None:
    types = {t.name: t for t in contact_types()}
    assert list(types) == ["point", "rolling", "sliding", "fluid"]
    assert [types[n].sphere_fit_max for n in types] == pytest.approx([22e-6, 12e-6, 16e-6, 16e-6])
    assert types["rolling"].calibrated_max == pytest.approx(8e-6)


TYPES = (DATA / "contact_types.toml").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[type]]\nname = "magnetic"\n', "type 1: Object missing required field `contact`"),
        (TYPES.replace('name = "point"', "name = true"), "type 1: Expected `str`, got `bool`"),
        (TYPES.replace("supports = 3", "supports = -1", 1), r"type 1: Expected `int` >= 0 - at `\$.supports`"),
        (TYPES.replace('"22 um"', '"-22 um"'), "sphere_fit_max = -2.2e-05, expected above 0 m"),
        (TYPES.replace('"22 um"', '"5 km"'), "sphere_fit_max: '5 km', expected at most 100 m"),
    ],
)
def test_a_contact_type_that_is_none_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "types.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        contact_types(path)


def test_a_tooling_ball_of_radius_zero_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "budget.toml"
    path.write_text('tooling_ball = ["0 mm", "0 mm", "0 mm"]\n')
    _, settings = read_budget(path)
    with pytest.raises(InputError, match="radius 0"):
        budget_joint(JOINT, settings)
