"""Compare all printed numbers of a machine and their ± with the true values."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from experiments.blind.robot import world_of
from experiments.blind.session import Route
from experiments.coverage.truth import Exact, Hall, exact, hall, least, machine_of, poses_at
from gpmodel.api.calibrate import CalibrationResult, calibrate
from gpmodel.api.table import read_table
from gpmodel.application.compensate import GIVEN, corrected, joint_targets
from gpmodel.application.predict import coordinate_deviations
from gpmodel.application.usable import without_instrument
from gpmodel.application.verify import verified
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.numerics.interval import coverage_factor
from gpmodel.report.compare import compare

Row = dict[str, Any]
TARGETS = 40


def asked(number: int) -> Row:
    """One machine of known effects: deviations z of printed numbers in their σ, shares of coordinates within k σ,
    statements that hold."""
    stratum, case, name = machine_of(number)
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        here = hall(case, number, folder)
    effects = [name] if name else []
    tables = here.tables
    first, second = (calibrate(here.mechanism, t, effects) for t in tables)
    fit = first.calibrated.final
    wide = poses_at(fit.model.mechanism, first.calibrated.poses.dataset, here.new)
    true = exact(fit, wide)
    row = {"machine": number, "stratum": stratum, "arm": case.arm, "effect": name, "status": fit.status,
           "z": deviations(first, here, true), **predictions(first, here), **compensation(first, here),
           **certified(first, here), **standardised(first, here), **compared(first, second),
           **same_table(first, here, effects), **rechecked(first, tables[1], here), **width(first, here)}  # fmt: skip
    return row | {
        "k": round(factor_of(first), 3), "sigma": round(fit.sigma / (1e-3 * case.noise_mm), 3),
        "seconds": round(time.process_time() - started, 2),
    }  # fmt: skip


def deviations(result: CalibrationResult, here: Hall, true: Exact) -> dict[str, list[float]]:
    """(printed - true) / ± of effects, geometry, registration and tool."""
    fit, record = result.calibrated.final, result.record
    own = {e.name for e in result.calibrated.named}
    geometry = [
        (value - there) / deviation
        for e, kept, value, there, deviation in zip(
            fit.model.effects, fit.free, fit.theta, true.theta, fit.stderr, strict=True
        )
        if kept and e.name not in own
    ]
    effect = [
        (abs(e.value) - abs(amount)) / e.stderr
        for e, amount in zip(record.effects, here.amounts, strict=True)
        if e.stderr
    ]
    out = {"effect": effect, "geometry": geometry}
    for p in record.placement:
        kind = "tool" if p.name.startswith("tool") else "place" if p.unit == "m" else "turn"
        if p.stderr:
            out.setdefault(kind, []).append((p.value - true.placed[p.name]) / p.stderr)
    return {kind: [round(float(z), 2) for z in values] for kind, values in out.items()}


def predictions(result: CalibrationResult, here: Hall) -> Row:
    """Share of the coordinates of new poses within k σ of where the model predicts them."""
    fit, poses = result.calibrated.final, poses_of(result, here)
    saved = result.model.saved
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    sigma = coordinate_deviations(saved, poses, observed)
    off = observed.tip[:, :3, 3] - here.new.clean
    return {"predicted": _within(off, factor_of(result) * sigma)}


def compensation(result: CalibrationResult, here: Hall) -> Row:
    """Judge the points reached by compensated joint values, in the fitted registration."""
    poses = poses_of(result, here)
    saved = without_instrument(result.model.saved)
    targets = joint_targets(saved, poses.subset(np.arange(TARGETS)).dataset)
    q, status = corrected(saved, targets)
    given = np.isin(status, GIVEN)
    if not given.any():
        return {"compensated": None}
    reached = replace(targets.dataset.subset(np.flatnonzero(given)), q=q[given])
    at = prepare(saved.mechanism, reached)
    wanted = (saved.placement.roots(reached) @ targets.frames[given])[:, :3, 3]
    off = true_points(here, q[given]) - wanted
    sigma = coordinate_deviations(saved, at, observe(saved.model, at, saved.theta, saved.placement))
    return {"compensated": _within(off, factor_of(result) * sigma)}


def true_points(here: Hall, q: np.ndarray) -> np.ndarray:
    """(N, 3) where the machine's point is at joint values (N, n), in the instrument's frame."""
    machine, row = here.machine, np.zeros(len(q))
    world = world_of(machine.arm, q, {}, row, machine.tool, machine.placement)
    rng = np.random.default_rng(0)
    return machine.under(outliers=0.0, repeats=1).measured(here.amounts, Route(q, np.arange(len(q))), world, rng).clean


def poses_of(result: CalibrationResult, here: Hall) -> Poses:
    """The new poses as this calibration's user would have them."""
    return poses_at(result.calibrated.final.model.mechanism, result.calibrated.poses.dataset, here.new)


def certified(result: CalibrationResult, here: Hall) -> Row:
    """The bounds that the certificate states, and the same of NEW poses measured afterwards, mm."""
    fit, poses, found = result.calibrated.final, poses_of(result, here), result.record.further
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    off = 1e3 * np.linalg.norm(observed.tip[:, :3, 3] - here.new.measured, axis=1)
    there = {"rms": np.sqrt(np.mean(off**2)), "within_95": np.percentile(off, 95), "largest": off.max()}
    said = {} if found is None else {k: getattr(found, k).bound_mm for k in there}
    return {"said": _short(said), "there": _short(there)}


def standardised(result: CalibrationResult, here: Hall) -> Row:
    """AP and RP of ISO 9283 less what they are over many more poses and repeats, in their U.

    AP is of the new poses; of RP the noise is drawn anew, while poses that are taken up again differ as they did.
    """
    accurate, again = result.record.positioning, result.record.repeatability
    if accurate is None or again is None or again.rp_stderr_mm is None:
        return {}
    case, rng = here.machine.case, np.random.default_rng(0)
    fit, poses = result.calibrated.final, poses_of(result, here)
    off = observe(fit.model, poses, fit.theta, fit.placement).tip[:, :3, 3] - here.new.clean
    sheet = here.sheets[0]
    count = len(off), case.repeats, 3
    read = 1e-3 * (case.noise_mm * rng.normal(size=count) + case.shared_mm * rng.normal(size=(len(off), 1, 3)))
    missed = float(1e3 * np.linalg.norm(read.mean(axis=1) - off, axis=1).mean())
    there = sheet.clean[np.argsort(sheet.pose, kind="stable")].reshape(-1, case.repeats, 3)
    there = there[rng.integers(len(there), size=len(off))] + read
    own = 1e3 * np.linalg.norm(there - there.mean(axis=1, keepdims=True), axis=2)
    repeated = float(np.mean(own.mean(axis=1) + 3 * own.std(axis=1, ddof=1)))
    return {
        "ap": round((accurate.after_mm - missed) / accurate.after_stderr_mm / coverage_factor(accurate.poses - 1), 3),
        "rp": round((again.rp_mean_mm - repeated) / again.rp_stderr_mm / coverage_factor(again.poses - 1), 3),
    }  # fmt: skip


def rechecked(result: CalibrationResult, table: pd.DataFrame, here: Hall) -> Row:
    """The chance that `verify` finds of so much while nothing changed, of another table of the unchanged machine."""
    found = verified(result.model.saved, read_table(table, here.mechanism))
    return {"verify": round(found.found.chance, 5), "named": len(found.changes), "verdict": found.verdict}


def width(result: CalibrationResult, here: Hall) -> Row:
    """Median of printed σ over the least possible: of numbers, and of predicted coordinates."""
    fit, saved = result.calibrated.final, result.model.saved
    best = least(fit, result.calibrated.poses, here.machine.case, here.sheets[0])
    poses = poses_of(result, here).subset(np.arange(TARGETS))
    observed = observe(fit.model, poses, fit.theta, fit.placement)
    ideal = replace(saved, covariance=replace(saved.covariance, values=best))
    held = np.diag(best) > 0
    numbers = np.sqrt(np.diag(fit.covariance.values)[held] / np.diag(best)[held])
    points = coordinate_deviations(saved, poses, observed) / coordinate_deviations(ideal, poses, observed)
    return {"width": round(float(np.median(numbers)), 3), "width_predicted": round(float(np.median(points)), 3)}


def factor_of(result: CalibrationResult) -> float:
    """k of the printed 95 % interval ± k σ."""
    return coverage_factor(result.record.freedom or np.inf)


def compared(first: CalibrationResult, second: CalibrationResult) -> Row:
    """List the changes that `compare` reports for two tables of one unchanged machine."""
    found = compare(first.record, second.record)
    every = (*found.effects, *(() if found.incomparable else found.parameters), *found.placement)
    return {
        "change": round(min(c.chance for c in every), 5), "compared": len(every),
        "change_z": [round(c.in_deviations, 2) for c in every],
    }  # fmt: skip


def same_table(first: CalibrationResult, here: Hall, effects: list[str]) -> Row:
    """List the changes that `compare` reports for two fits of one table: another held-out share, and geometry alone."""
    other = calibrate(here.mechanism, here.tables[0], effects, holdout=0.2, seed=1)
    found = compare(first.record, other.record)
    every = (*found.effects, *found.parameters, *found.placement)
    out = {"same_changed": sum(c.significant for c in every)}
    if effects:
        found = compare(first.record, calibrate(here.mechanism, here.tables[0], []).record)
        out["without_changed"] = sum(c.significant for c in (*found.parameters, *found.placement))
    return out


def _within(off: np.ndarray, sigma: np.ndarray) -> float:
    return round(float(np.mean(np.abs(off) <= sigma)), 4)


def _short(values: dict[str, float]) -> dict[str, float]:
    return {k: round(float(v), 5) for k, v in values.items()}
