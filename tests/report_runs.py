"""Reports of small searches, made once per session, for the tests of pages, texts and files."""

from dataclasses import replace
from functools import cache

import numpy as np
from effect_cases import measure, mechanism
from loop_cases import SMALL, quick, robot

from gpmodel.application.compensator import slot_task
from gpmodel.calibration.comparison import fit_steps, nested_models, steps_of
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.loop import discover
from gpmodel.discovery.state import Discovery
from gpmodel.evolution.input_histogram import histogram
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.runs import KeptRuns, Plan, run_all
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.executor import Threads
from gpmodel.families.by_name import effects_named
from gpmodel.families.catalogue import catalogue
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import standard_effects
from gpmodel.report.build import Ladder
from gpmodel.report.effects import from_calibration
from gpmodel.report.from_discovery import compensation, from_discovery, from_evolution
from gpmodel.report.origin import Origin
from gpmodel.report.schema import Report
from gpmodel.table.blocks import hold_out

FAMILIES = (
    "base_compliance", "joint_compliance", "joint_bending", "eccentricity", "gear_harmonic", "transmission_ripple",
    "joint_curve", "axis_wobble", "following",
)  # fmt: skip


@cache
def found(case: str) -> Discovery:
    """nothing, gear or windup, as the loop finds it among a few families and small populations."""
    truth, train, heldout = robot(case, 0)
    search = replace(SMALL, population=64, generations=8)
    offered = tuple(family for family in catalogue if family.name in FAMILIES)
    arm = truth.model.mechanism
    return discover(arm, truth.poses, train, heldout, candidates=offered, search=search, seed=0)


@cache
def discovered(case: str = "gear") -> Report:
    """nothing, gear or windup, as the loop found it."""
    return from_discovery(found(case), Origin("gpmodel discover measured.csv", 0, 1.5))


@cache
def quickly() -> Report:
    """The gear error beside a search too short to find anything itself, and an instrument of 0.03 mm."""
    return from_discovery(quick(), Origin("gpmodel discover measured.csv", 0, 1.5, 3e-5))


@cache
def calibrated(holdout: float = 0.3) -> Report:
    """A base compliance, declared; without held-out poses where `holdout` is 0."""
    arm = mechanism("irb6400r")
    effects = effects_named("base_compliance", arm, measure("irb6400r", (), (), 0, count=4).poses.states)
    truth = measure("irb6400r", effects, (3e-7,), 0, count=60)
    poses, geometry = truth.poses, standard_effects(arm, ("*",))
    train, held = np.arange(60), np.zeros(0, dtype=np.int64)
    if holdout:
        train, held = hold_out(poses.dataset, holdout, np.random.default_rng(0))
    steps = fit_steps(
        arm, nested_models(geometry, [("base_compliance", effects)]), poses.subset(train), poses.subset(held)
    )
    final = calibrate(steps[-1].calibration.model, poses)
    return from_calibration(
        Ladder(poses, train, steps, final, effects), Origin("gpmodel calibrate measured.csv", 0, 0.4)
    )


@cache
def evolved() -> Report:
    """Two short runs on the residual of the gear error, and two on shuffled ones."""
    discovery = found("gear")
    arm, poses, train = discovery.mechanism, discovery.poses, discovery.train
    fit = calibrate(ErrorModel(arm, discovery.standard_model), poses.subset(train))
    task = slot_task(fit, arm, poses.subset(train), 0)
    settings = {"linear": Settings(Linear(), budget=Budget(64, 4, seconds=1e9))}
    plan = Plan(settings, 2, 0)
    done = run_all(plan.tasks(task.problem), Threads(1), KeptRuns(), lambda _: None)
    runs = [plan.run(number, found, task.problem, task.heldout) for number, found in done]
    counted = histogram([run.record() for run in runs], task.problem.inputs.names, 0.05)
    unseen = poses.subset(np.setdiff1d(np.arange(len(poses)), train))
    start = Ladder(poses, train, steps_of([("standard", fit)], poses.subset(train), unseen), fit, final_rows=train)
    origin = Origin("gpmodel evolve measured.csv", 0, 2.0)
    return from_evolution(start, runs, counted, origin, compensation(runs, task.problem))


REPORTS = {
    "gear": discovered,
    "nothing": lambda: discovered("nothing"),
    "windup": lambda: discovered("windup"),
    "quick": quickly,
    "calibrated": calibrated,
    "nothing held out": lambda: calibrated(0.0),
    "evolved": evolved,
}
