"""Test that the error of a pose held out in turn is that of a selection without the pose."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from instrument_cases import simulated
from loop_cases import found

import gpmodel as gp
from gpmodel.api.discover import DiscoveryResult
from gpmodel.arrays import IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.folds import discover_by_folds
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.observation import observations
from gpmodel.report.build import OWN_UNIT
from gpmodel.table.blocks import FOLD_SEED, folds

ALONE = Search(runs=0, workers=1)


@pytest.fixture(scope="module")
def of_folds() -> DiscoveryResult:
    table = gp.simulate("irb6400r", ["gear_harmonic J4=60 arcsec"], poses=40, seed=1).table
    return gp.discover("irb6400r", table, search=ALONE)


@pytest.mark.long
def test_the_errors_of_a_pose_are_those_of_a_choice_without_it(of_folds: DiscoveryResult) -> None:
    found = of_folds.found
    poses = found.poses
    assert len(found.train) == len(found.heldout) == len(poses)
    assert [f.candidate.inputs for f in found.findings] == [("J4",)]
    fold = folds(poses.dataset, found.folds, np.random.default_rng(FOLD_SEED))
    standard = found.steps[1]
    for k in range(found.folds):
        seen, held = poses.subset(np.flatnonzero(fold != k)), np.flatnonzero(fold == k)
        own = calibrate(ErrorModel(found.mechanism, standard.calibration.model.effects), seen, seed=FOLD_SEED)
        np.testing.assert_allclose(standard.heldout_error[held], errors_on(own, poses.subset(held)), rtol=1e-6)
    last = found.steps[-1].heldout_error
    assert np.isfinite(last).all()
    assert np.mean(last**2) > np.mean(found.fitted.calibration.error**2)
    assert found.confirmation is not None
    assert found.confirmation.passed


def test_more_folds_than_groups_are_refused() -> None:
    table = gp.simulate("irb6400r", poses=48, seed=1).table
    with pytest.raises(InputError, match="folds: 50, expected 2 to 48"):
        gp.discover("irb6400r", table, folds=50)


def test_folds_and_a_share_exclude_each_other() -> None:
    table = gp.simulate("irb6400r", poses=40, seed=1).table
    with pytest.raises(InputError, match="folds: cannot be combined with holdout; expected one of the two"):
        gp.discover("irb6400r", table, folds=4, holdout=0.3)


@pytest.mark.long
def test_a_report_of_folds_says_so_and_holds_an_error_of_every_pose(of_folds: DiscoveryResult, tmp_path: Path) -> None:
    record = of_folds.record
    assert (record.data.folds, record.data.train, record.data.heldout) == (5, 40, 40)
    assert all(rung.heldout.known and rung.train.known for rung in record.ladder)
    of_folds.report(tmp_path)
    assert "40 poses, each held out once" in (tmp_path / "report.html").read_text()
    rows = (tmp_path / "poses.csv").read_text().splitlines()[1:]
    assert sum(row.split(",")[1] == "held out" for row in rows) == 40
    assert all(row.split(",")[4] for row in rows)


def test_a_table_is_judged_one_way_whatever_the_seed_of_the_search() -> None:
    """Split and fits of the standard model; with evolution left out nothing else has a seed."""
    table = gp.simulate("irb6400r", poses=40, seed=1).table
    once, again = (
        gp.discover("irb6400r", table, holdout=0.3, seed=seed, search=gp.Search(runs=0, max_effects=0)).record
        for seed in (0, 7)
    )
    assert once.ladder == again.ladder
    assert (once.seed, again.seed) == (0, 7)


NOTHING = gp.Search(runs=0, max_effects=0)


@pytest.mark.long
@pytest.mark.parametrize("instrument", ["camera", "planes", "points", "bar"])
def test_of_few_poses_every_one_is_held_out_once_however_many_rows_show_it(instrument: str) -> None:
    made = simulated(instrument)
    found = gp.discover(made.truth.mechanism, made.table, search=NOTHING)
    record, rows = found.record, len(made.table)
    assert (record.data.folds, record.data.heldout) == (5, rows)
    of_pose = np.unique(np.round(made.table.q, 6), axis=0, return_inverse=True)[1].reshape(-1)
    for part in found.found.parts:
        assert not set(of_pose[part.train]) & set(of_pose[part.heldout])
    kinds = {kind.name: kind for kind in observations(found.found.poses.dataset)}
    (left,), rung = [r for r in record.readings if r.name != "position"], record.ladder[-1]
    kind = kinds[left.name]
    in_metres = kind.metres / OWN_UNIT[kind.unit][1] * np.sqrt(kind.readings.sum() / rows)
    assert 1e3 * in_metres * left.after == pytest.approx(rung.heldout.rms_mm, rel=0.05)
    assert 1e3 * in_metres * left.after > 1.01 * rung.train.rms_mm


@pytest.mark.long
def test_repeats_are_no_further_poses() -> None:
    once = gp.simulate("irb6400r", poses=60, seed=1).table
    thrice = once.subset(np.arange(60).repeat(3))
    rng = np.random.default_rng(0)
    thrice = replace(thrice, position=thrice.position + 1e-5 * rng.normal(size=(180, 3)), row=np.arange(1, 181))
    assert gp.discover("irb6400r", thrice, search=NOTHING).record.data.folds == 5


@dataclass(frozen=True)
class Told:
    """A loop that makes the same of any poses, with the error that its last step has on those held out."""

    like: Discovery
    error: float
    asked: list[int] = field(default_factory=list)

    def __call__(self, poses: Poses, train: IntArray, heldout: IntArray) -> Discovery:
        self.asked.append(len(heldout))
        rng = np.random.default_rng(int(heldout.sum()))
        noise = np.abs(rng.normal(size=len(heldout)))
        errors = (1.0, 1.0, self.error)
        steps = tuple(replace(s, heldout_error=e * noise) for s, e in zip(self.like.steps, errors, strict=True))
        return replace(self.like, poses=poses, train=train, heldout=heldout, steps=steps)


@pytest.mark.long
@pytest.mark.parametrize(
    ("evolved", "first", "second", "limit", "confirmed", "times"),
    [
        (True, 0.5, 9.0, 0.1, True, 0), (True, 1.1, 0.5, 0.05, True, 5), (True, 1.1, 1.1, 0.05, False, 5),
        (False, 1.1, 0.5, 0.1, False, 0),
    ],
)  # fmt: skip
def test_what_was_evolved_is_asked_of_repetitions_that_evolve_where_others_do_not_confirm_it(
    evolved: bool, first: float, second: float, limit: float, confirmed: bool, times: int
) -> None:
    like = found("windup", 0)
    finding = like.findings[0]
    made = replace(finding.candidate, family="", found_by="sequence") if evolved else finding.candidate
    law = replace(finding.hypothesis, candidate=made)
    like = replace(like, findings=(replace(finding, hypothesis=law),), steps=like.steps[:3])
    ways = Told(like, first), Told(like, second)
    answer = discover_by_folds(Told(like, 1.0), ways, like.poses, 5, Criteria(), ALONE.here)
    assert len(ways[1].asked) == times
    assert answer.confirmation is not None
    assert (answer.confirmation.limit, answer.confirmed) == (limit, confirmed)
    assert (answer.final is like.final) == confirmed
    error = answer.steps[-1].heldout_error
    assert np.isfinite(error).all()
    assert len(answer.parts) == 5
