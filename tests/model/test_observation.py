"""Test that one file adds a kind of observation: a probe that reads its height over a plane."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from effect_cases import NOISE, Truth, bare, mechanism, random_placement, sized
from loop_cases import QUICK

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.result import errors_on
from gpmodel.calibration.start import placement_after
from gpmodel.discovery.loop import discover
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, drive_effect
from gpmodel.model.error_model import ErrorModel, measured_minus, observe, prepare
from gpmodel.model.observation import OfTip, Own, Tips
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import hold_out

ARM = "irb6400r"


@dataclass(frozen=True)
class Height(OfTip):
    """The tip's height over a plane fixed to the root, z = a x + b y + c: values (N,), m, along the root's z axis."""

    name: str
    values: Array
    unit: str = field(default="m", init=False)
    metres: float = field(default=1.0, init=False)
    components: int = field(default=1, init=False)
    absolute: bool = field(default=False, init=False)
    oriented: bool = field(default=False, init=False)

    @property
    def own(self) -> dict[str, tuple[str, ...]]:
        return {self.name: ("slope x", "slope y", "offset")}

    @property
    def readings(self) -> Mask:
        return np.isfinite(self.values)[:, None]

    def subset(self, rows: IntArray) -> "Height":
        return Height(self.name, self.values[rows])

    def residual(self, tips: Tips, own: Own) -> Array:
        plane = own[self.name]
        return (self.values - tips.root[:, 2, 3] + tips.root[:, :2, 3] @ plane[:2] + plane[2])[:, None]

    def by_tip(self, tips: Tips, own: Own) -> Array:
        normal = np.array([-own[self.name][0], -own[self.name][1], 1.0])
        return np.concatenate([tips.turn @ normal, np.zeros((len(self.values), 3))], axis=1)[:, None, :]

    def by_own(self, tips: Tips, own: Own) -> Array:
        return -np.column_stack([tips.root[:, :2, 3], np.ones(len(self.values))])[:, None, :]

    def start(self, tips: Tips) -> Own:
        seen = np.isfinite(self.values)
        if seen.sum() < 3:
            raise InputError(f"{self.name}: {int(seen.sum())} heights; its plane needs at least 3")
        columns = -self.by_own(tips, {})[seen, 0]
        return {self.name: np.linalg.lstsq(columns, tips.root[seen, 2, 3] - self.values[seen], rcond=None)[0]}


def probed(effects: tuple[Effect, ...], millimetres: float, count: int, noise: float = NOISE) -> Truth:
    """A robot that only heights were read of: four probes on the tool see four planes; no point is ever measured."""
    arm, rng = mechanism(ARM), np.random.default_rng(7)
    data = bare(ARM, count, 7, payload=False)
    planes = {f"plane {i}": np.append(rng.uniform(-0.8, 0.8, 2), 0.3) for i in range(4)}
    data = replace(data, observations=tuple(Height(name, np.zeros(count)) for name in planes))
    placement = replace(random_placement(data, rng), registration={"": np.eye(4)}, anchors=planes)
    theta = sized(ARM, effects, data, millimetres) if effects else np.zeros(0)
    model = ErrorModel(arm, effects)
    seen = -measured_minus(observe(model, prepare(arm, data), theta, placement), data)[:, 6:]
    heights = seen + noise * rng.normal(size=seen.shape)
    read = tuple(Height(name, heights[:, i]) for i, name in enumerate(planes))
    return Truth(prepare(arm, replace(data, observations=read)), model, theta, placement)


def gear() -> tuple[Effect, ...]:
    joint = mechanism(ARM).joints[3]
    return tuple(drive_effect(f"gear {f}", joint, Expression(f"{f}(2*J4)")) for f in ("sin", "cos"))


def test_its_columns_are_the_derivatives_of_its_readings() -> None:
    truth = probed((), 0.0, 12, noise=0.0)
    problem = linearise(truth.model, truth.poses, truth.theta, truth.placement, Weighting({}, np.ones(12, dtype=bool)))
    assert problem.placement_names[3:6] == ("plane 0 slope x", "plane 0 slope y", "plane 0 offset")
    for k in range(problem.placement):
        step, moved = np.zeros(problem.placement), []
        for side in (1, -1):
            step[k] = side * 1e-6
            there = placement_after(problem.observed, truth.placement, step)
            seen = observe(truth.model, truth.poses, truth.theta, there)
            moved.append(measured_minus(seen, truth.poses.dataset)[:, 6:].ravel())
        np.testing.assert_allclose(problem.columns[:, k], (moved[1] - moved[0]) / 2e-6, atol=1e-7)


def test_it_calibrates_what_it_sees_and_what_it_has_to_find_of_itself() -> None:
    truth = probed(gear(), 0.5, 60)
    fit = calibrate(truth.model, truth.poses)
    assert fit.status == "converged"
    assert (np.abs(fit.theta - truth.theta) < 4 * fit.stderr).all()
    assert fit.sigma == pytest.approx(NOISE, rel=0.2)
    for name, plane in truth.placement.anchors.items():
        np.testing.assert_allclose(fit.placement.anchors[name], plane, atol=1e-3)
    assert np.sqrt(np.mean(errors_on(fit, truth.poses) ** 2)) < 2.2 * NOISE


@pytest.mark.long
def test_the_loop_finds_an_undeclared_effect_from_it() -> None:
    truth = probed(gear(), 0.5, 90)
    train, heldout = hold_out(truth.poses.dataset, 0.3, np.random.default_rng(0))
    standard = tuple(e for e in geometric_effects(mechanism(ARM)) if e.name in ("J2 Ry", "J3 Ry"))
    found = discover(truth.model.mechanism, truth.poses, train, heldout, standard=standard, search=QUICK)
    assert {i for f in found.findings for e in f.candidate.effects for i in e.inputs} == {"J4"}
    assert np.mean(found.steps[-1].heldout_error) < 0.3 * np.mean(found.steps[1].heldout_error)


def test_too_little_for_its_own_unknowns_is_refused_by_name() -> None:
    truth = probed((), 0.0, 2)
    with pytest.raises(InputError, match="plane 0: 2 heights; its plane needs at least 3"):
        calibrate(truth.model, truth.poses)
