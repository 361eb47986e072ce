"""Discovery on a further machine with the result of a fleet as prior."""

from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, run
from fleet_cases import GEOMETRY, NOISE, two_joint_arms

import gpmodel as gp
from gpmodel.api.discover import DiscoveryResult
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.planning.simulate import simulate
from gpmodel.table.dataset import Dataset

GEAR = "gear_harmonic J2=200 arcsec"
QUICK = gp.Search(runs=0, workers=1)


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six arms with a gear error each, and the result of their fleet."""
    folder = two_joint_arms(tmp_path_factory.mktemp("like") / "arms", 6)
    gp.fleet(None, folder, ["gear_harmonic J2"]).save(folder / "fleet.json")
    return folder


def further(arms: Path, poses: int, *effects: str, geometry: float = GEOMETRY, seed: int = 5) -> Dataset:
    """A further arm."""
    mechanism, rng = MechanismChoice(str(arms / "arm.toml")).load(), np.random.default_rng(seed)
    q = random_poses(mechanism, poses, rng)
    return simulate(mechanism, q, effects, rng, noise=NOISE, geometry_sigma=geometry).dataset


def like(arms: Path, table: Dataset) -> DiscoveryResult:
    """Search a further arm, given its type."""
    return gp.discover(arms / "arm.toml", table, like=arms, search=QUICK)


@pytest.mark.long
def test_ten_poses_of_a_brother_are_enough(arms: Path) -> None:
    table = further(arms, 210, GEAR)
    few, later = table.subset(np.arange(10)), table.subset(np.arange(10, 210))
    found = like(arms, few)
    alone = gp.calibrate(arms / "arm.toml", few, ["gear_harmonic J2"], holdout=0.0)
    errors = [np.mean(fit.model.misses(later) ** 2) for fit in (found, alone)]
    assert errors[0] < errors[1]
    assert np.sqrt(errors[0]) < 3.0 * np.sqrt(3.0) * 1e3 * NOISE
    assert found.findings == ()
    assert "Prior of 6 machines of the type, which has gear error, 2 per turn, J2." in found.verdict
    titles = [found.record.title(rung) for rung in found.record.ladder]
    assert titles == ["registration only", "its own poses alone", "the prior of the fleet"]


@pytest.mark.long
def test_poses_chosen_by_the_type_tell_a_further_machine_better_than_random_ones(arms: Path) -> None:
    mechanism = MechanismChoice(str(arms / "arm.toml")).load()
    chosen = gp.choose_poses(mechanism, 6, like=arms)
    assert chosen.said == "like 6 machines of the type"

    def error(q: np.ndarray, seed: int) -> float:
        rng = np.random.default_rng(seed)
        every = np.vstack([random_poses(mechanism, 200, rng), q])
        table = simulate(mechanism, every, (GEAR,), rng, noise=NOISE, geometry_sigma=GEOMETRY).dataset
        fit = gp.calibrate(mechanism, table.subset(np.arange(200, len(every))), fleet=arms, holdout=0.0)
        return float(np.mean(fit.model.misses(table.subset(np.arange(200))) ** 2))

    seeds = range(5)
    drawn = [random_poses(mechanism, 6, np.random.default_rng(100 + seed)) for seed in seeds]
    by_choice, by_chance = ([error(q, s) for s, q in zip(seeds, of, strict=True)] for of in ([chosen.q] * 5, drawn))
    assert np.median(by_choice) < 0.8 * np.median(by_chance)


@pytest.mark.long
def test_what_a_machine_alone_has_is_found_beside_its_type(arms: Path) -> None:
    found = like(arms, further(arms, 40, GEAR, "gear_harmonic J1=300 arcsec"))
    assert [f.name for f in found.findings] == ["gear error, 2 per turn, J1"]
    assert "the prior of the fleet" in found.verdict
    assert {e.name for e in found.model.saved.model.effects} > {"gear error, 2 per turn, J2, sin"}


@pytest.mark.long
def test_a_machine_that_is_no_brother_is_searched_without_the_prior(arms: Path) -> None:
    found = like(arms, further(arms, 40, geometry=30.0 * GEOMETRY))
    assert "is unlike the machines of its type" in found.verdict
    assert [rung.step for rung in found.record.ladder] == ["registration", "standard"]


@pytest.mark.long
def test_a_machine_that_is_no_brother_is_calibrated_without_the_prior(arms: Path) -> None:
    table = further(arms, 240, GEAR, geometry=30.0 * GEOMETRY)
    few, later = table.subset(np.arange(12)), table.subset(np.arange(40, 240))
    known, alone = (gp.calibrate(arms / "arm.toml", few, **how, holdout=0.0) for how in (
        {"fleet": arms}, {"effects": ["gear_harmonic J2"]}))  # fmt: skip
    assert "is unlike the machines of its type" in known.verdict
    assert "the prior of the type is not used" in known.verdict
    assert [rung.step for rung in known.record.ladder] == ["registration", "standard"]
    np.testing.assert_allclose(known.model.misses(later), alone.model.misses(later), rtol=0.2, atol=1e3 * NOISE)


@pytest.mark.long
def test_bad_input_is_one_line(arms: Path, tmp_path: Path) -> None:
    gp.simulate("ur5", poses=12).save(tmp_path / "other.csv")
    said = "--mechanism", "ur5", "--out", tmp_path / "out", "--like"
    assert "--like: is of machines of another type" in one_line(run("discover", tmp_path / "other.csv", *said, arms), 2)
    assert "cannot be read" in one_line(run("discover", tmp_path / "other.csv", *said, tmp_path / "none"), 2)
    few = "poses", "--mechanism", "ur5", "--quiet", "--like"
    assert "--like: is of machines of another type" in one_line(run(*few, arms), 2)
    with_criterion = run(*few, arms, "--criterion", "spread")
    assert "--like: cannot be combined" in one_line(with_criterion, 2)
    both = run("discover", tmp_path / "other.csv", *said, arms, "--joint", "J1=somewhere")
    assert "cannot be combined with joints" in one_line(both, 2)
    assert not (tmp_path / "out").exists()
