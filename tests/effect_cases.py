"""Mechanisms, and measured poses of them with any simulated effects."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from robots_cases import STANDARD_DH

from gpmodel.arrays import Array
from gpmodel.discovery.state import Discovery
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset, unmeasured
from joints import spherical_joint
from robots import load_mechanism

NOISE = 3e-5
GANTRY = """
convention = "modified"
[[joint]]
name = "X"
kind = "prismatic"
alpha_deg = 90
theta_deg = 90
[[joint]]
name = "Y"
kind = "prismatic"
alpha_deg = -90
theta_deg = -90
[[joint]]
name = "Z"
kind = "prismatic"
alpha_deg = -90
"""
"""Three prismatic axes, and no length at all."""


def _palletiser() -> str:
    """An arm whose forearm is turned from the base, and whose wrist stays level; its angles are rounded."""
    rows = (
        ("J1", "base", "0 0 1", "0 0 0", 300, "0.1 0 -0.3", ""),
        ("J2", "J1", "0.25 0 0", "-1.5708 -1.5708 0", 120, "0.5 0 0", ""),
        ("J3_with", "J2", "1.1 0 0", "0 0 1.5708", 0, "0 0 0", '<mimic joint="J2" multiplier="-1"/>'),
        ("J3", "J3_with", "0 0 0", "0 0 0", 90, "0.4 0 0", ""),
        ("JW", "J3", "1.25 0 0", "0 0 0", 20, "0.06 0 0", '<mimic joint="J3" multiplier="-1"/>'),
        ("J4", "JW", "0.22 0 0", "-1.5708 0 0", 10, "0 0 0", ""),
    )
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for name, *_, mass, com, _ in rows
    )  # fmt: skip
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/>{mimic}</joint>'
        for name, parent, xyz, rpy, _, _, mimic in rows
    )  # fmt: skip
    return f'<robot name="palletiser"><link name="base"/>{links}{joints}</robot>'


WRITTEN = {"dh": ("dh.toml", STANDARD_DH), "gantry": ("gantry.toml", GANTRY), "palletiser": ("arm.urdf", _palletiser())}
MECHANISMS = ("irb6400r", "ur5", "dh", "gantry", "palletiser", "spherical-joint")


@cache
def mechanism(name: str) -> Mechanism:
    """One of MECHANISMS; the spherical joint with its angles measured, so that every effect shows."""
    if name == "spherical-joint":
        return spherical_joint().with_angles(measured=True)
    if name not in WRITTEN:
        found = load_mechanism(name)
        assert found is not None
        return found
    with tempfile.TemporaryDirectory() as folder:
        file, text = WRITTEN[name]
        path = Path(folder) / file
        path.write_text(text)
        found = load_mechanism(str(path))
    assert found is not None
    return found


def bare(
    name: str, count: int, seed: int = 0, *, setups: int = 1, tools: int = 1, payload: bool = True,
    in_order: bool = False,
) -> Dataset:  # fmt: skip
    """Poses with every kind of input column, nothing measured yet."""
    arm = mechanism(name)
    rng = np.random.default_rng([seed, 1])
    q = random_poses(arm, count, rng)
    extras = {"temperature": rng.uniform(18.0, 30.0, count)}
    units = {"temperature": "degC"}
    for joint in arm.joints[:3]:
        extras[f"approach_{joint.name}"] = rng.choice([-1.0, 1.0], count)
        units[f"approach_{joint.name}"] = "1"
    for axis, values in zip("xyz", rng.normal(size=(3, count)), strict=True):
        extras[f"gravity_{axis}"], units[f"gravity_{axis}"] = values, "1"
    labels = {}
    if setups > 1:
        labels["setup"] = np.array([f"s{i % setups}" for i in range(count)])
    if tools > 1:
        labels["tool"] = np.array([f"t{(i // 2) % tools}" for i in range(count)])
    bare = unmeasured([j.name for j in arm.joints], q, rng.uniform(0.0, 20.0, count) if payload else None)
    return replace(bare, labels=labels, extras=extras, extra_units=units, in_order=in_order)


def random_placement(dataset: Dataset, rng: np.random.Generator, anchors: Sequence[str] = ()) -> Placement:
    """Instruments metres away, tools centimetres off the flange."""
    at = {s: se3.exp(np.append(rng.normal(0, 2, 3), rng.uniform(-1.5, 1.5, 3))) for s in dataset.codes("setup")[0]}
    tool = {t: se3.exp(np.append(rng.uniform(0.05, 0.15, 3), np.zeros(3))) for t in dataset.codes("tool")[0]}
    return Placement(at, tool, {a: np.append(rng.uniform(-3.0, 3.0, 3), rng.normal(0.0, 0.05)) for a in anchors})


@dataclass(frozen=True)
class Truth:
    """A measured table and what it was made with."""

    poses: Poses
    model: ErrorModel
    theta: Array
    placement: Placement


def measure(
    name: str, effects: Sequence[Effect], theta: Sequence[float] | Array, seed: int, *, count: int = 90,
    noise: float = NOISE, geometry: float = 3e-4, see: Sequence[str] = ("position",), setups: int = 1, tools: int = 1,
    dataset: Dataset | None = None,
) -> Truth:  # fmt: skip
    """Poses of a robot with random geometric errors, the given effects and noise.

    see: of position, rotation and distance; noise and geometry: standard deviations, m (and rad).
    """
    arm = mechanism(name)
    rng = np.random.default_rng([seed, 2])
    data = bare(name, count, seed, setups=setups, tools=tools, payload=False) if dataset is None else dataset
    anchors = tuple(f"distance_{i}" for i in range(4)) if "distance" in see else ()
    data = replace(data, distances={a: np.zeros(len(data)) for a in anchors})
    placement = random_placement(data, rng, anchors)
    if "position" not in see and "rotation" not in see:
        placement = replace(placement, registration={s: np.eye(4) for s in placement.registration})
    constant = geometric_effects(arm) if geometry else ()
    values = np.concatenate([geometry * rng.normal(size=len(constant)), np.asarray(theta, dtype=float)])
    model = ErrorModel(arm, (*constant, *effects))
    seen = observe(model, prepare(arm, data), values, placement)
    position = rotation = np.full((len(data), 3), np.nan)
    if "position" in see:
        position = seen.tip[:, :3, 3] + noise * rng.normal(size=(len(data), 3))
    if "rotation" in see:
        turn = se3.exp(np.hstack([np.zeros((len(data), 3)), noise * rng.normal(size=(len(data), 3))]))[:, :3, :3]
        rotation = se3.rotation_vector(turn @ seen.tip[:, :3, :3])
    distances = {a: seen.distances[:, i] + noise * rng.normal(size=len(data)) for i, a in enumerate(anchors)}
    data = replace(data, position=position, rotation=rotation, distances=distances)
    return Truth(prepare(arm, data), model, values, placement)


def true_tips(truth: Truth, poses: Poses) -> Array:
    """Noise-free points (N, 3) of the true robot at any poses."""
    return observe(truth.model, poses, truth.theta, truth.placement).tip[:, :3, 3]


@cache
def first_of_each_family(name: str, count: int = 90, seed: int = 0) -> dict[str, Candidate]:
    """One candidate a family with an instance on the mechanism: the last one, on a distal joint where there is one.

    Of effects with priors the first, on the joint with the longest lever: on the last they hide in the noise.
    """
    arm = mechanism(name)
    data = bare(name, count, seed, in_order=True)
    pool = catalogue.candidates(arm, measure(name, (), (), seed, dataset=data).poses.states)
    believed = [c for c in pool if np.isfinite(c.effects[0].prior)]
    return {c.family: c for c in (*pool, *reversed(believed))}


def numbers(found: Discovery) -> list[float]:
    """All that a discovery claims, as numbers to compare exactly."""
    out = [*found.final.theta, *found.final.error]
    for step in found.steps:
        out += [*step.train_error, *step.heldout_error]
    for entry in found.rounds:
        out += [*entry.exploration.null_nats, *entry.exploration.histogram.p_values]
        out += [v for h in entry.hypotheses for v in (h.score.nats, h.chance.p, h.cv_rms)]
    return [float(v) for v in out]


def residuals(truth: Truth, placement: Placement, theta: Array, model: ErrorModel) -> Array:
    """Measured minus predicted (N, m) of any model at the poses of a truth."""
    return measured_minus(observe(model, truth.poses, theta, placement), truth.poses.dataset)


def sized(name: str, effects: Sequence[Effect], dataset: Dataset, millimetres: float, seed: int = 0) -> Array:
    """Values (E,), of random direction, with which the effects together move the flange by an RMS of this many mm.

    Effects with a prior are one deviation of it large.
    """
    arm = mechanism(name)
    rng = np.random.default_rng([seed, 3])
    if np.isfinite(effects[0].prior):
        return np.array([e.prior for e in effects]) * rng.choice([-1.0, 1.0], len(effects))
    poses = prepare(arm, dataset)
    placement = random_placement(dataset, rng)
    rest = observe(ErrorModel(arm, ()), poses, np.zeros(0), placement).tip[:, :3, 3]
    poses = prepare(arm, replace(dataset, position=rest))
    direction = rng.normal(size=len(effects))
    largest = max(float(np.abs(e.twist(poses.states, s)).max()) for e in effects for s in e.slots)
    small = 1e-5 / largest * direction
    moved = observe(ErrorModel(arm, tuple(effects)), poses, small, placement).tip[:, :3, 3] - rest
    return small * 1e-3 * millimetres / float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
