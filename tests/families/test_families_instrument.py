"""Test that errors of the instrument are named as errors of the instrument."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates, catalogue, instances
from gpmodel.families.instrument import OUT_OF_ORDER
from gpmodel.mechanism.protocol import INSTRUMENT, places
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import seen_columns
from gpmodel.selection.group import CAP, Shapes, group_of
from gpmodel.table.dataset import Specification

ARM = mechanism("ur5")
POSES = 200
SHAPES = {
    "range offset of the instrument": lambda p: p / np.linalg.norm(p, axis=1)[:, None],
    "eccentricity of the instrument's azimuth": lambda p: (
        np.sin(np.arctan2(p[:, 1], p[:, 0]) + 0.7)[:, None] * np.column_stack([-p[:, 1], p[:, 0], np.zeros(len(p))])
    ),
}


@cache
def table() -> Poses:
    return measure("ur5", (), (), 4, dataset=bare("ur5", POSES, 4, payload=False)).poses


def off_by(shift: Array) -> tuple[Residual, tuple[Candidate, ...]]:
    """Return the residual of a robot whose instrument is off by `shift` (N, 3), m, and the catalogue."""
    data = table().dataset
    poses = prepare(ARM, replace(data, position=data.position + shift))
    fit = calibrate(ErrorModel(ARM, geometric_effects(ARM)), poses)
    return residual_of(fit, poses, Criteria(), 0), candidates(ARM, poses.states)


def leading(there: Residual, pool: tuple[Candidate, ...]) -> Candidate:
    return pool[int(np.argmax([s.nats for s in scores(there, pool)]))]


@pytest.mark.long
@pytest.mark.parametrize("name", SHAPES)
def test_an_error_written_out_in_polar_coordinates_is_the_instruments(name: str) -> None:
    """Errors of an instrument that sees the robot within a quarter of a turn are indistinguishable."""
    moved = SHAPES[name](table().dataset.position)
    assert leading(*off_by(1.5e-4 * moved / np.sqrt(np.mean(np.sum(moved**2, axis=1))))).family.startswith(
        "instrument_"
    )


def test_the_index_of_the_elevation_moves_points_along_their_meridian() -> None:
    pool = candidates(ARM, table().states)
    effects = next(c.effects for c in pool if c.name == "elevation index of the instrument")
    model = ErrorModel(ARM, effects)
    truth = measure("ur5", effects, (1e-3,), 4, dataset=bare("ur5", POSES, 4, payload=False), noise=0.0, geometry=0.0)
    before = observe(ErrorModel(ARM, ()), truth.poses, np.zeros(0), truth.placement).tip[:, :3, 3]
    after = observe(model, truth.poses, np.array([1e-3]), truth.placement).tip[:, :3, 3]
    first, second = seen_columns(before), seen_columns(after)
    np.testing.assert_allclose(second["instrument_elevation"] - first["instrument_elevation"], 1e-3, rtol=1e-9)
    for same in ("instrument_range", "instrument_azimuth"):
        np.testing.assert_allclose(second[same], first[same], atol=1e-12)


@pytest.mark.long
def test_without_its_walk_the_instrument_stands_where_it_stood_on_average() -> None:
    states = table().states
    walks = [c for c in candidates(ARM, states) if c.family == "instrument_walk"]
    waves = np.array([basis(states) for c in walks for basis in c.bases])
    assert len(waves) > 0
    np.testing.assert_allclose(waves.mean(axis=1), 0.0, atol=1 / POSES)
    assert (np.ptp(waves, axis=1) > 0.9).all()


@pytest.mark.long
def test_a_walk_and_a_smooth_field_are_the_instruments() -> None:
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.normal(size=(POSES, 3)), axis=0)
    assert leading(*off_by(1e-4 * walk / np.std(walk))).family in {"instrument_walk", "drift", "set_up_step"}
    p = table().dataset.position
    field = np.column_stack([np.sin(2.2 * p[:, 1] + 0.4), np.cos(1.9 * p[:, 0]), np.sin(2.0 * p[:, 2] + 1.0)])
    assert leading(*off_by(1.5e-4 * field)).family == "instrument_field"


@pytest.mark.long
def test_a_sound_instrument_gets_no_error() -> None:
    there, pool = off_by(np.zeros((POSES, 3)))
    mine = [c for c in pool if c.family.startswith("instrument")]
    assert len(mine) >= 9
    assert max(s.nats for s in scores(there, mine)) < 5.0


def test_prediction_contains_the_instrument_and_the_mechanism_alone_does_not() -> None:
    pool = candidates(ARM, table().states)
    effects: tuple[Effect, ...] = tuple(e for c in pool if c.family == "instrument_azimuth" for e in c.effects)
    effects = tuple(replace(e, prior=np.inf) for e in effects)
    theta = sized("ur5", effects, table().dataset, 0.3, seed=1)
    model, placement = ErrorModel(ARM, effects), measure("ur5", (), (), 4, dataset=table().dataset).placement
    unseen = prepare(ARM, replace(table().dataset, position=np.full((POSES, 3), np.nan)))
    with_it = observe(model, unseen, theta, placement).tip[:, :3, 3]
    alone, none = model.of_the_mechanism(theta)
    without = observe(alone, unseen, none, placement).tip[:, :3, 3]
    assert (alone.effects, len(none)) == ((), 0)
    assert np.sqrt(np.mean(np.sum((with_it - without) ** 2, axis=1))) > 1e-4
    assert places(ARM)[-1] == INSTRUMENT


def specified() -> Poses:
    data = table().dataset
    return prepare(ARM, replace(data, instrument=Specification(15e-6, 6e-6)))


def instances_now(poses: Poses) -> dict[str, Candidate]:
    """Return the candidates of the instrument that a search is offered, without walks of its stand."""
    offers = [f for f in catalogue if f.name.startswith("instrument_") and f.name != "instrument_walk"]
    return {c.name: c for f in offers for c in instances(f, ARM, poses.states, search=True)}


def test_errors_by_angles_and_distance_need_an_instrument_at_the_origin() -> None:
    """The origin of a table in the robot's frame is within the robot; a smooth field has no origin."""
    data = table().dataset
    own = replace(data, position=data.position - data.position.mean(axis=0))
    families = [{c.family for c in instances_now(prepare(ARM, d)).values()} for d in (data, own)]
    assert families[1] == {"instrument_field"}
    assert families[0] == families[1] | {f"instrument_{of}" for of in ("range", "azimuth", "elevation", "axes")}


def test_without_a_specification_an_error_has_the_price_of_an_instrument_out_of_order() -> None:
    named = {c.name: c.cost for c in candidates(ARM, table().states)}
    for name, candidate in instances_now(table()).items():
        assert candidate.cost == pytest.approx(named[name] + OUT_OF_ORDER)


def test_every_error_alone_reaches_the_specification_at_the_distances_of_the_table() -> None:
    """An angle more than at these distances only where it grows with the elevation; a field as all its terms do."""
    poses = specified()
    limit = Specification(15e-6, 6e-6).at(poses.dataset.position)
    for name, candidate in instances_now(poses).items():
        if candidate.specified:
            moved = np.zeros(3)
            for effect in candidate.effects:
                twist = effect.prior * effect.twist(poses.states, INSTRUMENT)
                shift = twist[:, :3] + np.cross(twist[:, 3:], poses.dataset.position)
                moved = moved + np.mean(shift**2, axis=0)
            assert 0.3 * limit < np.sqrt(moved.sum()) < 2.0 * limit, name


def test_what_is_beyond_the_specification_is_offered_at_a_price_and_only_where_there_is_one() -> None:
    offered = instances_now(specified())
    assert instances_now(table()).keys() == {name for name, c in offered.items() if c.specified}
    for name, candidate in offered.items():
        if candidate.specified:
            beyond = offered[f"{name}, beyond its specification"]
            assert beyond.effects == candidate.effects
            assert beyond.cost == candidate.cost + OUT_OF_ORDER


def test_a_group_within_the_specification_goes_no_further() -> None:
    poses = specified()
    shapes = Shapes(poses.states)
    for candidate in instances_now(poses).values():
        group = group_of(candidate, shapes)
        assert group is not None
        if candidate.specified:
            told = [e.prior for e in group.with_prior(group.cap**2)]
            assert told == pytest.approx([e.prior for e in group.effects])
        else:
            assert group.cap == CAP
