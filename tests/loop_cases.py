"""Robots with one undeclared effect, and the whole search on them with small settings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from effect_cases import Truth, bare, measure, mechanism, sized, true_tips

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.tree import Tree
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, drive_effect
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import hold_out

ARM = "irb6400r"
BOTH = (Linear(), Tree())
SMALL = Search(strategies=BOTH, runs=2, workers=1, population=256, generations=20)
"""Populations and generations just large enough for the cases here."""
QUICK = Search(runs=1, workers=1, population=48, generations=4)
"""For what does not depend on how much is found."""


def _gear() -> tuple[Effect, ...]:
    joint = mechanism(ARM).joints[3]
    return tuple(drive_effect(f"true {f}", joint, Expression(f"{f}(2*J4)")) for f in ("sin", "cos"))


def _windup() -> tuple[Effect, ...]:
    """Return the wind-up of joint 3, whose torque depends on two angles.

    About joint 2 it is so nearly one of J2 that no data can distinguish them.
    """
    return (drive_effect("true", mechanism(ARM).joints[2], Expression("tanh(torque_J3/400)")),)


@dataclass(frozen=True)
class Case:
    """Undeclared effects, their displacement of the flange (RMS, mm), and the inputs that identify them."""

    effects: tuple[Effect, ...]
    millimetres: float
    inputs: frozenset[str]


CASES = {
    "nothing": Case((), 0.0, frozenset()),
    "gear": Case(_gear(), 0.2, frozenset({"J4"})),
    "windup": Case(_windup(), 2.0, frozenset({"torque_J3"})),
}


@cache
def robot(case: str, seed: int, count: int = 80) -> tuple[Truth, IntArray, IntArray]:
    """The measured robot, its training rows and those held out."""
    data = bare(ARM, count, seed, payload=False)
    effects = CASES[case].effects
    theta: Sequence[float] | Array = sized(ARM, effects, data, CASES[case].millimetres, seed) if effects else ()
    truth = measure(ARM, effects, theta, seed, dataset=data)
    return truth, *hold_out(truth.poses.dataset, 0.25, np.random.default_rng(0))


@cache
def found(case: str, seed: int, search: Search = SMALL) -> Discovery:
    """The loop's answer."""
    truth, train, heldout = robot(case, seed)
    return discover(truth.model.mechanism, truth.poses, train, heldout, search=search, seed=seed)


@cache
def quick() -> Discovery:
    """The gear error, of the catalogue, found beside a search too short to find anything itself."""
    truth, train, heldout = robot("gear", 0)
    return discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK)


def rms(error: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def against_the_oracle(case: str, seed: int, answer: Discovery) -> float:
    """Error on sixty fresh poses without noise, over that of a calibration told the effect."""
    truth, train, _ = robot(case, seed)
    arm = truth.model.mechanism
    oracle = calibrate(ErrorModel(arm, (*geometric_effects(arm), *CASES[case].effects)), truth.poses.subset(train))
    fresh = prepare(arm, bare(ARM, 60, seed + 1000, payload=False))
    clean: Poses = prepare(arm, replace(fresh.dataset, position=true_tips(truth, fresh)))
    return rms(errors_on(answer.steps[-1].calibration, clean)) / rms(errors_on(oracle, clean))
