"""Test linear axes (ISO 230-1), ripples at any frequency, and error motions of rotating axes."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from effect_cases import NOISE, bare, measure, mechanism, sized
from instances import some
from residual_cases import best_nats

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.families import session as memory
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates, catalogue
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism, WeightByPart
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.dataset import Dataset, unmeasured
from gpmodel.testing.effects import check_family
from joints import spherical_joint
from robots import load_mechanism
from robots.chain import SerialChain

SLIDE = next(j for j in mechanism("dh").joints if j.kind == "prismatic")
OWN = SLIDE.drive[0][1][1].upper()


@cache
def pool(name: str, poses: int) -> dict[str, Candidate]:
    data = bare(name, poses, 2, payload=False)
    return {c.name: c for c in candidates(mechanism(name), prepare(mechanism(name), data).states)}


def grids(name: str) -> list[FrequencyGrid]:
    states = prepare(mechanism(name), bare(name, 150, 2, payload=False)).states
    return [c for f in catalogue for c in f.grids(mechanism(name), states)]


def test_the_six_error_motions_of_a_slide_have_their_names() -> None:
    mine = {n.split(", ")[0] for n, c in pool("dh", 150).items() if c.family == "linear_axis"}
    ways, turns = "XYZ", "ABC"
    own = ways.index(OWN)
    straight = {f"straightness E{w}{OWN}" for w in ways if w != OWN}
    tilts = {f"pitch or yaw E{t}{OWN}" for i, t in enumerate(turns) if i != own}
    assert mine == straight | tilts | {f"positioning E{OWN}{OWN}", f"roll E{turns[own]}{OWN}"}


def test_a_linear_joint_follows_the_angle_of_its_neighbours() -> None:
    mine = {c.name: c for c in pool("dh", 150).values() if c.family == "wrist_coupling"}
    slides = {name: c.unit for name, c in mine.items() if name.endswith(f"to {SLIDE.name}")}
    assert slides == {f"coupling, J2 to {SLIDE.name}": "m/rad", f"coupling, J4 to {SLIDE.name}": "m/rad"}


def test_a_carriage_tilts_about_every_axis_about_which_weights_turn_it() -> None:
    """Gravity along z has no moment about z; a carriage on a level rail rolls and pitches."""
    rail = load_mechanism(str(Path(__file__).parents[2] / "docs" / "make" / "rail.toml"))
    check_family(next(f for f in catalogue if f.name == "joint_bending"), rail)
    data = unmeasured([j.name for j in rail.joints], random_poses(rail, 40, np.random.default_rng(0)))
    found = {c.name: c for c in candidates(rail, prepare(rail, data).states) if c.name.startswith("joint bending, X")}
    level = [c.inputs for name, c in found.items() if name.endswith("only")]
    assert sorted(level) == [("moment_X_x",), ("moment_X_z",)]
    assert found["joint bending, X"].inputs == ("moment_X_x", "moment_X_z")


def test_a_screw_off_its_centre_is_a_cyclic_error_of_its_lead() -> None:
    leads = {c.name for c in pool("dh", 150).values() if c.family == "cyclic_error"}
    assert f"cyclic error, every 10 mm, {SLIDE.name}" in leads
    there = next(c for c in grids("dh") if c.joint == SLIDE)
    truth = there.at(2000 * np.pi / 23.7)
    assert truth.name == f"cyclic error, every 23.7 mm, {SLIDE.name}"
    states = prepare(mechanism("dh"), bare("dh", 150, 2, payload=False)).states
    turn = 2 * np.pi / 0.0237 * (states[SLIDE.name] - there.start)
    found = [effect.terms[0].basis(states) for effect in truth.effects]
    np.testing.assert_allclose(found, [np.sin(turn), np.cos(turn)], atol=1e-4)


@pytest.mark.parametrize("name", ["dh", "ur5"])
def test_a_comb_is_finer_than_its_poses_tell_and_pays_for_all_they_do(name: str) -> None:
    states = prepare(mechanism(name), bare(name, 150, 2, payload=False)).states
    for there in grids(name):
        width = 2 * np.pi / float(np.ptp(states[there.joint.name]))
        assert there.step <= width / 4 * 1.001
        independent = (there.rates[-1] - there.rates[0]) / width
        assert np.exp(there.template.cost - 4.0) == pytest.approx(independent, rel=0.01)
        rate = float(there.rates[len(there.rates) // 2])
        assert there.value(there.value(rate)) == pytest.approx(rate)


def test_wobble_and_run_out_are_curves_on_every_axis_but_the_drives() -> None:
    mine = [c for c in pool("ur5", 150).values() if c.family == "axis_motion"]
    assert len(mine) == 5 * len(mechanism("ur5").joints)
    for joint in mechanism("ur5").joints:
        drive = joint.drive[0]
        assert not any(e.terms[0].axis == drive[1] and e.terms[0].slot == drive[0] for c in mine for e in c.effects)


def test_all_joints_curves_come_as_one_block_too() -> None:
    block = pool("ur5", 150)["error curve of the angle, every joint"]
    assert {i for e in block.effects for i in e.inputs} == {j.name for j in mechanism("ur5").joints}
    assert block.has_priors


POSES = 150


def weighing(name: str, factors: str) -> Mechanism:
    """An arm as described: right masses, none at all, or each wrong by a factor of four, to either side."""
    arm = mechanism(name)
    assert isinstance(arm, SerialChain)
    scale = {"right": (1.0, 1.0), "none": (0.0, 0.0), "wrong": (0.25, 4.0)}[factors]
    links = tuple(replace(link, mass=link.mass * scale[k % 2]) for k, link in enumerate(arm.links))
    return replace(arm, links=links)


@cache
def measured(name: str, joint: int, millimetres: float = 0.5) -> Poses:
    """A robot whose one weak drive yields to its true torque."""
    data = bare(name, POSES, 6, payload=False)
    arm = mechanism(name)
    of_joint = f"joint compliance, {arm.joints[joint].name}"
    weak = next(c for c in candidates(arm, prepare(arm, data).states) if c.name == of_joint)
    return measure(name, weak.effects, sized(name, weak.effects, data, millimetres), 6, dataset=data).poses


def found(arm: Mechanism, poses: Poses) -> tuple[Candidate, float]:
    """The best of the catalogue, and the RMS of what it leaves, m."""
    poses, model = prepare(arm, poses.dataset), ErrorModel(arm, geometric_effects(arm))
    there = residual_of(calibrate(model, poses), poses, Criteria(), 0)
    pool = candidates(arm, poses.states)
    best = pool[int(np.argmax([s.nats for s in scores(there, pool)]))]
    fit = calibrate(ErrorModel(arm, (*model.effects, *best.effects)), poses)
    return best, float(np.sqrt(np.mean(fit.error**2)))


RIGHT, NONE, WRONG = {"joint_compliance"}, {"unknown_masses"}, {"unknown_masses", "wrong_masses"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "joint", "masses", "families"),
    [
        ("irb6400r", 2, "right", RIGHT), ("ur5", 1, "right", RIGHT), ("ur5", 1, "none", NONE), ("dh", 1, "none", NONE),
        ("ur5", 1, "wrong", WRONG),
    ],
)  # fmt: skip
def test_a_weak_joint_is_found_whatever_is_known_of_the_masses(
    name: str, joint: int, masses: str, families: set[str]
) -> None:
    arm = weighing(name, masses)
    best, rms = found(arm, measured(name, joint))
    assert best.family in families
    assert best.name.endswith(f", {arm.joints[joint].name}")
    assert rms < 1.15 * np.sqrt(3) * NOISE


@pytest.mark.long
def test_a_measured_torque_speaks_for_an_arm_without_masses() -> None:
    poses = measured("irb6400r", 2)
    torque = -poses.states["torque_J3"] + np.random.default_rng(0).normal(0, 3.0, POSES)
    extras = {**poses.dataset.extras, "tau_3": torque}
    data = replace(poses.dataset, extras=extras, extra_units={**poses.dataset.extra_units, "tau_3": "N*m"})
    best, rms = found(weighing("irb6400r", "none"), replace(poses, dataset=data))
    assert best.name == "joint compliance, J3"
    assert rms < 1.15 * np.sqrt(3) * NOISE


@pytest.mark.parametrize("masses", ["none", "wrong"])
def test_an_innocent_robot_yields_to_no_unknown_mass(masses: str) -> None:
    arm = weighing("irb6400r", masses)
    poses = prepare(arm, measure("irb6400r", (), (), 6, count=POSES).poses.dataset)
    there = residual_of(calibrate(ErrorModel(arm, geometric_effects(arm)), poses), poses, Criteria(), 0)
    mine = [c for c in candidates(arm, poses.states) if c.family.endswith("_masses")]
    assert len(mine) >= 5
    assert max(s.nats for s in scores(there, mine)) < 5.0


@pytest.mark.long
def test_only_mechanisms_that_weigh_their_parts_are_offered_unknown_masses() -> None:
    free = spherical_joint()
    assert not isinstance(free, WeightByPart)
    loaded = MechanismChoice("spherical-joint").load()
    assert loaded.unit_loads(np.zeros((2, len(free.joints)))) == {}
    for each in (free, loaded):
        offered = candidates(each, prepare(each, bare("spherical-joint", 20)).states)
        assert not any(c.family.endswith("_masses") for c in offered)
    arm = MechanismChoice("ur5").load()
    assert any(c.family == "unknown_masses" for c in candidates(arm, prepare(arm, bare("ur5", 20)).states))


ARM = mechanism("irb6400r")
FAMILIES = {"play_last_move", "friction_windup", "hysteresis", "lagged_growth", "settling"}
FLOOR = 5.0


@cache
def table(kind: str = "poses") -> Dataset:
    """120 rows in order over 5 hours: independent poses, a walk, or 40 poses measured three times with jitter."""
    data = bare("irb6400r", 120, 3, payload=False)
    rng = np.random.default_rng(4)
    q = data.q.copy()
    if kind == "walk":
        q = np.clip(np.cumsum(0.08 * rng.normal(size=q.shape), axis=0) + q[0], q.min(0), q.max(0))
    if kind == "repeats":
        q = np.repeat(q[:40], 3, axis=0) + 2e-5 * rng.normal(size=q.shape)
    time = np.cumsum(rng.uniform(1.0, 4.0, 120))
    room = 21.0 + 3.0 * np.sin(2 * np.pi * time / 260.0)
    return replace(
        data, q=q, extras={"time": time, "temperature": room}, extra_units={"time": "min", "temperature": "degC"}
    )


def pool_memory(data: Dataset) -> tuple[Candidate, ...]:
    return candidates(ARM, prepare(ARM, data).states)


def left_over(data: Dataset, effects: tuple, theta: Array, moved: Array | None = None) -> Residual:
    truth = measure("irb6400r", effects, theta, 5, dataset=data)
    poses = truth.poses
    if moved is not None:
        poses = prepare(ARM, replace(poses.dataset, position=poses.dataset.position + moved))
    return residual_of(calibrate(ErrorModel(ARM, geometric_effects(ARM)), poses), poses, Criteria(), 0)


PLANTED = {
    "play by the last move, J2": "poses",
    "friction windup, J3": "walk",
    "hysteresis over its angle, J1": "walk",
    "growth of the arm (temperature, lag of 53 min)": "poses",
    "tilt of J1 (temperature, lag of 53 min)": "poses",
}


@pytest.mark.long
@pytest.mark.parametrize(("name", "kind"), PLANTED.items())
def test_of_the_whole_catalogue_the_planted_one_saves_most(name: str, kind: str) -> None:
    offered = {c.name: c for c in pool_memory(table(kind))}
    there = left_over(table(kind), offered[name].effects, sized("irb6400r", offered[name].effects, table(kind), 0.3))
    best = max(zip(offered, scores(there, tuple(offered.values())), strict=True), key=lambda pair: pair[1].nats)
    assert best[0] == name
    assert best[1].nats > 20.0


@pytest.mark.long
@pytest.mark.parametrize("kind", some(["poses", "walk", "repeats"], "walk"))
def test_an_innocent_robot_has_no_memory(kind: str) -> None:
    there = left_over(table(kind), (), np.zeros(0))
    mine = [c for c in pool_memory(table(kind)) if c.family in FAMILIES]
    assert len(mine) > 300
    rng = np.random.default_rng(0)
    assert max(s.nats for s in scores(there, mine)) < FLOOR
    assert np.mean(best_nats(there, mine, rng.normal(size=(len(there.values), 40))) < FLOOR) > 0.9


@pytest.mark.long
def test_a_drifting_instrument_is_called_a_drift() -> None:
    data = table()
    creep = 4e-4 * np.linspace(0.0, 1.0, 120)[:, None] * np.array([0.6, -0.5, 0.62])
    there = left_over(data, (), np.zeros(0), creep)
    offered = pool_memory(data)
    best = offered[int(np.argmax([s.nats for s in scores(there, offered)]))]
    assert best.family == "drift"


@pytest.mark.long
def test_without_an_order_of_the_rows_nothing_remembers() -> None:
    data = replace(table(), extras={}, extra_units={})
    assert not {c.family for c in pool_memory(data)} & FAMILIES
    said = {c.family for c in pool_memory(replace(data, in_order=True))}
    assert said & FAMILIES == {"play_last_move", "friction_windup", "hysteresis", "settling"}
    assert not [c for f in (memory.play_last_move,) for c in f(ARM, prepare(ARM, data).states)]


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("columns", "in_order", "side"),
    [
        ((), False, {}),
        ((), True, dict.fromkeys(("J2", "J3"), "last_move_{}")),
        (("approach_J2",), False, {"J2": "approach_J2"}),
        (("approach_J2",), True, {"J2": "approach_J2", "J3": "last_move_J3"}),
        (("approach", "approach_J3"), True, {"J2": "approach", "J3": "approach_J3"}),
    ],
)
def test_a_declared_direction_of_approach_replaces_the_last_move(
    columns: tuple[str, ...], in_order: bool, side: dict[str, str]
) -> None:
    data, rng = bare("irb6400r", 120, 3, payload=False), np.random.default_rng(6)
    declared = {name: rng.choice([-1.0, 1.0], 120) for name in columns}
    data = replace(data, extras=declared, extra_units=dict.fromkeys(columns, "1"), in_order=in_order)
    offered = {c.name: c for c in pool_memory(data)}
    for joint in ("J2", "J3"):
        way = side.get(joint, "").format(joint)
        windup = offered.get(f"friction windup, {joint}")
        assert (windup is not None) == bool(way)
        if windup is not None:
            assert windup.effects[0].inputs == (way,)
            assert set(windup.effects[1].inputs) == {way, f"torque_{joint}"}
        read = {name for c in offered.values() for name in c.inputs}
        assert (f"last_move_{joint}" in read) == way.startswith("last_move")
        assert (f"hysteresis over its angle, {joint}" in offered) == way.startswith("last_move")


@pytest.mark.parametrize("opposite", [1.0, -1.0])
def test_a_declared_direction_that_the_rows_confirm_leaves_the_hysteresis(opposite: float) -> None:
    data = replace(bare("irb6400r", 120, 3, payload=False), in_order=True)
    moves = prepare(ARM, data).states["last_move_J2"]
    data = replace(data, extras={"approach_J2": opposite * moves}, extra_units={"approach_J2": "1"})
    offered = {c.name for c in pool_memory(data)}
    assert "hysteresis over its angle, J2" in offered
    assert "play by the last move, J2" not in offered
