"""Run gpmodel on one blind robot and record its numbers, their errors and their ±."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.blind.case import Case, effect
from experiments.blind.cases import CASES
from experiments.blind.files import truth_of, write
from experiments.blind.generate import make
from experiments.blind.grading import grade, worse
from experiments.blind.robot import Robot
from experiments.coverage import told
from gpmodel.api.arguments import load_mechanism
from gpmodel.api.calibrate import checked_poses
from gpmodel.api.discover import COMMAND, DiscoveryResult
from gpmodel.api.table import dataset_of, read_table
from gpmodel.application.kinematics import with_model_labels
from gpmodel.application.model_file import saved_model
from gpmodel.application.predict import coordinate_deviations
from gpmodel.application.usable import usable
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.families.by_name import effects_named
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.report.origin import Origin
from gpmodel.table.blocks import hold_out, replicates

_EFFECTS = {
    "compliance": ("kuka_like", effect("compliance", 0.2, joint=3), "joint compliance, J3"),
    "ratio": ("staubli_like", effect("gear_ratio", 0.15, joint=3), "gear ratio, J3"),
    "coupling": ("puma_like", effect("coupling", 0.15, source=4, joint=5), "coupling, J4 to J5"),
    "eccentric": ("irb_like", effect("harmonic", 0.2, joint=3, per_turn=1), "eccentricity, 1 per turn, J3"),
}
_SHARED = {"poses": 180, "repeats": 3, "shared_mm": 0.04}
_MEASURED = {
    "single": {"poses": 80, "noise_mm": 0.03},
    "labelled": {**_SHARED, "noise_mm": 0.015, "labelled": True},
    "jitter": {**_SHARED, "noise_mm": 0.01},
    "repeated": {"poses": 180, "repeats": 3, "noise_mm": 0.03, "labelled": True},
}
DECLARED = {f"{kind} {how}": name for kind, (_, _, name) in _EFFECTS.items() for how in _MEASURED}
"""The catalogue's name of the one effect that a robot of the family `known` has."""


_ROWS = (
    Case("walk", "kuka_like", 120, 0.03, walk_mm=0.06),
    Case("walk_in_order", "irb_like", 150, 0.03, walk_mm=0.06, columns=("time", "room"), order="walk"),
)
"""Innocent robots under a tracker that wanders at random: neighbouring rows err alike."""

_CLUSTERED = (
    Case("twelve_clusters", "irb_like", 120, 0.02, order="clusters", shared_mm=0.05),
    Case("twenty_clusters", "ur_like", 200, 0.02, order="clusters", shared_mm=0.05),
)
"""Innocent robots measured in clusters of ten neighbouring poses that err alike, and no label says so."""


def _named(names: str) -> dict[str, Case]:
    return {name: CASES[name] for name in names.split()}


FAMILIES: dict[str, dict[str, Case]] = {
    "known": {
        f"{kind} {how}": Case(f"{kind} {how}", arm, effects=(undeclared,), **measured)
        for kind, (arm, undeclared, _) in _EFFECTS.items()
        for how, measured in _MEASURED.items()
    },
    "independent": _named("null_ur null_outliers null_columns null_seven plain_cobot"),
    "dependent": _named("repeats_labelled repeats_jitter clusters student narrow two_move small_moves"),
    "instrument": _named("range_offset range_scale azimuth smooth_field tracker_walk tracker_drift"),
    "independent_aside": _named("null_puma null_outliers_ur null_payload null_four plain_rail plain_gantry"),
    "dependent_aside": _named(
        "repeats_labelled_puma repeats_jitter_kuka clusters_seven student_welder narrow_ten two_move_ur"
    ),
    "instrument_aside": _named(
        "elevation_index range_scale_seven azimuth_and_offset smooth_field_ten tracker_walk_ur tracker_walk_seven "
        "tracker_drift_ten"
    ),
    "rows": {c.name: c for c in _ROWS},
    "clustered": {c.name: c for c in _CLUSTERED},
    "single": {n: c for n, c in CASES.items() if c.family == "single" and c.effects},
    "several": {n: c for n, c in CASES.items() if c.family in ("several", "masses") and c.poses <= 200},
    "memory": {n: c for n, c in CASES.items() if c.family == "memory"},
    "linear": {n: c for n, c in CASES.items() if c.family == "linear"},
}


HELD_OUT = 0.3
DEPENDENCE = {"repeats", "rows", "space", "stretches"}
"""Tests of the acceptance rule that ask whether poses depend on one another."""
Row = dict[str, Any]


@dataclass(frozen=True)
class Bench:
    """A robot as its user has it: mechanism and poses, and tables of other poses with what is true there, m."""

    robot: Robot
    mechanism: Mechanism
    poses: Poses
    fresh: tuple[Poses, ...]

    @property
    def clean(self) -> np.ndarray:
        """(N, 3) where the fresh poses are."""
        return np.vstack([sheet.clean for sheet in self.robot.fresh])

    @property
    def noisy(self) -> np.ndarray:
        """(N, 3) where the fresh poses were measured."""
        return np.vstack([sheet.measured for sheet in self.robot.fresh])


def bench(case: Case, seed: int) -> Bench:
    """The robot of a case and a seed, by the files that its user would have."""
    robot = make(case, seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(robot, folder)
        mechanism = load_mechanism(str(folder / "robot.urdf"))
        table = read_table(folder / "table.csv", mechanism, in_order=case.in_order)
        mechanism, poses = checked_poses(mechanism, table, geometric_effects(mechanism))
        sheets = (
            dataset_of(folder / f"fresh_{k}.csv", mechanism, need_measurement=False) for k in range(len(robot.fresh))
        )
        fresh = tuple(prepare(mechanism, replace(sheet, in_order=case.in_order)) for sheet in sheets)
    return Bench(robot, mechanism, poses, fresh)


def known(case: Case, seed: int) -> Row:
    """The model that is true, fitted: deviations of its numbers and predictions in their standard deviations."""
    here = bench(case, seed)
    effects = effects_named(DECLARED[case.name], here.mechanism, here.poses.states)
    model = ErrorModel(here.mechanism, (*geometric_effects(here.mechanism), *effects))
    fit = calibrate(model, here.poses, seed=seed)
    clean = replace(here.poses.dataset, position=here.robot.train.clean)
    exact = calibrate(
        model, replace(here.poses, dataset=clean), start=fit, condition_limit=fit.condition_limit, robust=False
    )
    both = fit.free & exact.free
    own = np.array([e in effects for e in model.effects])
    off, robust = (
        np.divide(fit.theta - exact.theta, deviation, where=both, out=np.full(len(both), np.nan))
        for deviation in (fit.stderr, robust_stderr(fit, here.poses))
    )
    return {
        "geometry": _rounded(off[both & ~own]), "effect": _rounded(off[both & own]), "robust": _rounded(robust[both]),
        **predicted(here, fit),
    }  # fmt: skip


def robust_stderr(fit: Calibration, poses: Poses) -> np.ndarray:
    """Deviations (E,) by leaving each bundle of repeats out in turn, the two levels of the noise forgotten.

    (CᵀC)⁻¹ Σ_b C_bᵀ ẽ_b ẽ_bᵀ C_b (CᵀC)⁻¹ with ẽ_b = (I - H_bb)⁻¹ e_b. Source: MacKinnon and White (1985), HC3, by
    clusters (Bell and McCaffrey 2002).
    """
    use = np.ones(len(poses), dtype=bool)
    use[fit.outliers] = False
    problem = linearise(fit.model, poses, fit.theta, fit.placement, Weighting(fit.weights, use))
    free = np.concatenate([np.ones(problem.placement, dtype=bool), fit.free])
    scale = np.linalg.norm(problem.columns[:, free], axis=0)
    columns = problem.columns[:, free] / scale
    inverse = np.linalg.inv(columns.T @ columns)
    bundle = replicates(poses.dataset)[problem.pose_of_row]
    meat = np.zeros_like(inverse)
    for b in np.unique(bundle):
        own = columns[bundle == b]
        left = np.linalg.solve(np.eye(len(own)) - own @ inverse @ own.T, problem.residual[bundle == b])
        meat += np.outer(own.T @ left, own.T @ left)
    deviation = np.full(len(free), np.nan)
    deviation[free] = np.sqrt(np.diag(inverse @ meat @ inverse)) / scale
    return deviation[problem.placement :]


def found(case: Case, seed: int, search: Search) -> Row:
    """Return the findings of the loop, and whether they predict better than the standard model."""
    here = bench(case, seed)
    data = here.poses.dataset
    train, heldout = hold_out(data, HELD_OUT, np.random.default_rng(seed))
    loop = discover(here.mechanism, here.poses, train, heldout, search=search, seed=seed)
    report = DiscoveryResult(loop, Origin(COMMAND, seed, loop.seconds, None)).record
    shipped = loop.final if loop.confirmed else None
    said = [asdict(effect) for effect in report.effects] if shipped else []
    standard = calibrate(ErrorModel(here.mechanism, loop.standard_model), here.poses, seed=seed)
    ours = predicted(here, loop.final)
    plain = _points(here, standard)[0] - here.noisy
    off = _points(here, loop.final)[0] - here.noisy
    return {
        **grade(said, {**truth_of(here.robot), "seed": seed}), "confirmed": loop.confirmed,
        "unconfirmed": [] if shipped else [effect.name for effect in report.effects],
        "p": [effect.p_value for effect in report.effects], "stopped": stopped(loop),
        "standard_mm": _rms_mm(plain), "fresh_mm": _rms_mm(off), "worse": worse(off, plain),
        "better": worse(plain, off), "seconds": round(loop.seconds, 1), "told": told.deviations(here.robot), **ours,
    }  # fmt: skip


def stopped(loop: Discovery) -> dict[str, list[str]]:
    """Return the candidates that failed only the tests of dependent poses, and the tests they failed."""
    judged = {h.candidate.name: h for entry in loop.rounds for h in entry.hypotheses}
    failed = {name: [t.name for t in h.verdict.tests if not t.passed] for name, h in judged.items()}
    return {name: tests for name, tests in failed.items() if tests and set(tests) <= DEPENDENCE}


def predicted(here: Bench, fitted: Calibration) -> Row:
    """Share of the coordinates of fresh poses within two standard deviations of the predicted ones."""
    points, deviation = _points(here, fitted)
    return {"within": round(float(np.mean(np.abs(points - here.clean) <= 2.0 * deviation)), 4)}


def _points(here: Bench, fitted: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Predicted points (N, 3) of the fresh poses and standard deviation (N, 3) of each coordinate, m."""
    saved = usable(saved_model(fitted, here.poses), session=here.robot.by_row, as_measured=True)
    points, deviations = [], []
    for poses in here.fresh:
        ready = replace(poses, dataset=with_model_labels(saved, poses.dataset))
        observed = observe(saved.model, ready, saved.theta, saved.placement)
        points.append(observed.tip[:, :3, 3])
        deviations.append(coordinate_deviations(saved, ready, observed))
    return np.vstack(points), np.vstack(deviations)


def _rms_mm(error: np.ndarray) -> float:
    return round(float(1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1)))), 5)


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(v), 2) for v in values]
