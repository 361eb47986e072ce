"""report.json: everything the pages show, as plain numbers and text."""

import importlib.metadata
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from gpmodel import wording
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import Calibration, resolved
from gpmodel.calibration.unmeasured_joints import what_is_left
from gpmodel.calibration.unobservable import absorbed_families, absorbed_in_words
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.explore import Histogram
from gpmodel.discovery.result import Discovery, Round, Step
from gpmodel.model.error_model import measured_minus, observe
from gpmodel.model.sites import Site
from gpmodel.report.quantity import quantity, read_columns, shape, table_names, translate
from gpmodel.table.bundles import noise_floor

SCHEMA = 1
PACKAGES = ("gpmodel", "numpy", "scipy", "numba", "deap", "pin", "sympy")


def versions() -> dict[str, str]:
    """Versions of Python and the packages the numbers depend on."""
    out = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            out[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return out


def statistics_mm(error: Array) -> dict[str, float | None]:
    """Mean, RMS and maximum of 3-D errors (N,) in m, given in mm; nulls where there are none."""
    if len(error) == 0:
        return {"mean_mm": None, "rms_mm": None, "max_mm": None}
    mm = 1e3 * error
    return {"mean_mm": float(mm.mean()), "rms_mm": float(np.sqrt(np.mean(mm**2))), "max_mm": float(mm.max())}


def build(discovery: Discovery, command: str, seed: int, noise: float | None) -> dict[str, Any]:
    """The report of a discovery. noise: the instrument's figure, m, where the user gave one."""
    data = discovery.poses.dataset
    names = {**table_names(data.joints, data.columns or data.joints), **data.extra_names}
    floor = noise_floor(data) or noise
    floor_mm = None if floor is None else 1e3 * floor
    final = discovery.final
    effects = [_effect(discovery, i, names) for i in range(len(discovery.findings))]
    histograms = [_histogram(r.exploration.histogram, names) for r in discovery.rounds]
    report: dict[str, Any] = {
        "schema": SCHEMA,
        "command": command,
        "versions": versions(),
        "seed": seed,
        "data": {
            "file": data.source,
            "sha256": data.sha256,
            "poses": len(data),
            "train": len(discovery.train),
            "heldout": len(discovery.heldout),
            "outliers": [int(r) for r in data.row[final.outliers]],
        },
        "mechanism": {"name": discovery.mechanism.name, "joints": [names[j] for j in data.joints]},
        "ladder": [_rung(step) for step in discovery.steps],
        "effects": effects,
        "histogram": histograms[0] if histograms else _histogram(Histogram((), (), (), (), (), ()), names),
        "histograms": histograms,
        "rounds": [_round(r, names) for r in discovery.rounds],
        "parameters": _parameters(final, names),
        "rank_curve": [
            {"condition_limit": c.condition_limit, "rank": c.rank, "cv_rms_mm": 1e3 * c.cv_rms}
            for c in discovery.steps[1].calibration.rank_curve
        ],
        "condition_limit": final.condition_limit,
        "status": final.status,
        "reason": final.reason,
        "stopped": discovery.stopped,
        "noise_floor_mm": floor_mm,
        "plots": _plots(discovery, names),
        "seconds": discovery.seconds,
    }
    report["absorbed"] = [translate(name, names) for name in absorbed_families(final, discovery.poses)]
    report["verdict"] = " ".join(filter(None, (_verdict(report), absorbed_in_words(final, report["absorbed"]))))
    return report


def _rung(step: Step) -> dict[str, Any]:
    rung: dict[str, Any] = {
        "step": step.name,
        "train": statistics_mm(step.train_error),
        "heldout": statistics_mm(step.heldout_error),
        "rank": step.calibration.rank,
        "dropped": list(step.calibration.dropped),
    }
    if step.finding is not None:
        rung["effect"] = step.finding
    return rung


def _effect(discovery: Discovery, i: int, names: Mapping[str, str]) -> dict[str, Any]:
    finding = discovery.findings[i]
    candidate, hypothesis = finding.candidate, finding.hypothesis
    number = quantity(discovery.final, candidate, discovery.poses.states)
    first = candidate.effects[0].terms[0]
    inputs = list(dict.fromkeys(x for e in candidate.effects for x in e.inputs))
    partners = discovery.final.partners()
    step = next((s for s in discovery.steps if s.finding == i), None)
    return {
        "name": translate(candidate.name, names),
        "slot": translate(first.slot, names),
        "axis": first.axis,
        "basis": translate(number.basis, names),
        "inputs": [names.get(x, x) for x in read_columns(inputs)],
        "value": number.value,
        "stderr": number.stderr,
        "unit": number.unit,
        "unique_share": number.unique_share,
        "found_by": candidate.found_by,
        "catalogue": candidate.family or None,
        "explanation": candidate.explanation or "matches no named effect",
        "terms": [
            {
                "slot": translate(t.slot, names),
                "axis": t.axis,
                "basis": translate(str(t.basis), names),
                "weight": t.weight,
            }
            for e in candidate.effects[:6]
            for t in e.terms
        ],
        "rivals": [{"name": translate(n, names), "cv_rms_mm": 1e3 * v} for n, v in hypothesis.rivals],
        "correlation_partners": [
            [translate(n, names), c] for e in candidate.effects[:2] for n, c in partners.get(e.name, ())
        ][:8],
        "cv_rms_mm": 1e3 * hypothesis.cv_rms,
        "cv_before_mm": 1e3 * hypothesis.cv_before,
        "p_value": hypothesis.p_value,
        "gain": hypothesis.score.gain,
        "sign_stable": hypothesis.verdict.passed("sign"),
        "round": finding.round,
        "heldout_rms_mm": None if step is None else statistics_mm(step.heldout_error)["rms_mm"],
    }


def _histogram(histogram: Histogram, names: Mapping[str, str]) -> dict[str, Any]:
    return {
        "inputs": [names.get(x, x) for x in histogram.inputs],
        "linear": list(histogram.linear),
        "tree": list(histogram.tree),
        "shuffled": list(histogram.shuffled),
        "p_values": list(histogram.p_values),
        "significant": [names.get(x, x) for x in histogram.significant],
    }


def _round(entry: Round, names: Mapping[str, str]) -> dict[str, Any]:
    return {
        "round": entry.number,
        "candidates": [_tried(h, names) for h in entry.hypotheses],
        "null_nats": [float(v) for v in entry.exploration.null_nats if np.isfinite(v)],
        "dropped": [translate(n, names) for n in entry.dropped],
    }


def _tried(hypothesis: Hypothesis, names: Mapping[str, str]) -> dict[str, Any]:
    candidate = hypothesis.candidate
    first = candidate.effects[0].terms[0]
    return {
        "name": translate(candidate.name, names),
        "slot": translate(first.slot, names),
        "axis": first.axis,
        "basis": translate(str(first.basis), names),
        "inputs": [names.get(x, x) for e in candidate.effects[:1] for x in e.inputs],
        "gain": hypothesis.score.gain,
        "nats": hypothesis.score.nats,
        "cv_rms_mm": 1e3 * hypothesis.cv_rms,
        "found_by": candidate.found_by,
        "catalogue": candidate.family or None,
        "p_value": hypothesis.p_value,
        "accepted": hypothesis.accepted,
        "why": hypothesis.why,
    }


def _parameters(final: Calibration, names: Mapping[str, str]) -> list[dict[str, Any]]:
    partners = final.partners()
    out = []
    for i, effect in enumerate(final.model.effects):
        known = bool(np.isfinite(final.stderr[i]))
        out.append(
            {
                "name": translate(effect.name, names),
                "value": float(final.theta[i]),
                "stderr": float(final.stderr[i]) if known else None,
                "unit": effect.unit,
                "unique_share": float(final.unique_share[i]) if known else None,
                "partners": [[translate(n, names), c] for n, c in partners.get(effect.name, ())][:4],
                "kept": bool(final.kept[i]),
            }
        )
    return out


def _plots(discovery: Discovery, names: Mapping[str, str]) -> dict[str, Any]:
    poses = discovery.poses
    heldout = np.zeros(len(poses), dtype=bool)
    heldout[discovery.heldout] = True
    standard, last = discovery.steps[1].calibration, discovery.steps[-1].calibration
    states = poses.states
    return {
        "error_mm": {
            s.name: {"train": (1e3 * s.train_error).tolist(), "heldout": (1e3 * s.heldout_error).tolist()}
            for s in discovery.steps
        },
        "points_mm": (1e3 * np.column_stack([states[a] for a in "xyz"])).round(3).tolist(),
        "heldout_mask": heldout.tolist(),
        "residual_mm": {
            "standard": _finite(1e3 * _root_residual(standard, discovery)),
            "final": _finite(1e3 * _root_residual(last, discovery)),
        },
        "shapes": [s for i in range(len(discovery.findings)) if (s := _shape(discovery, i, heldout, names))],
    }


def _finite(values: Array) -> list[list[float | None]]:
    return [[round(float(v), 5) if np.isfinite(v) else None for v in row] for row in values]


def _root_residual(calibration: Calibration, discovery: Discovery) -> Array:
    data = discovery.poses.dataset
    poses = resolved(calibration, discovery.poses)
    observed = observe(calibration.model, poses, calibration.theta, calibration.placement)
    residual = measured_minus(observed, data)[:, :3]
    turn = np.stack([calibration.placement.registration[s][:3, :3] for s in data.label("setup").tolist()])
    return (np.swapaxes(turn, 1, 2) @ residual[:, :, None])[:, :, 0]


def _shape(discovery: Discovery, i: int, heldout: Array, names: Mapping[str, str]) -> dict[str, Any] | None:
    """Partial residual of a finding: its own contribution plus what the final model leaves along its column."""
    candidate, final = discovery.findings[i].candidate, discovery.steps[-1].calibration
    poses = resolved(final, discovery.poses)
    known = {e.name for e in final.model.effects}
    if not all(e.name in known for e in candidate.effects):
        return None
    observed = observe(final.model, poses, final.theta, final.placement)
    residual = np.nan_to_num(measured_minus(observed, poses.dataset))
    residual[:, 3:6] = 0.0
    first = candidate.effects[0]
    site = Site(tuple((t.slot, t.axis, t.weight) for t in first.terms[:1]))
    slot = discovery.mechanism.slots.index(site.slot)
    lever = observed.sensitivity(slot)[:, :, ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz").index(site.axis)] * site.terms[0][2]
    lever[:, 3:6] = 0.0
    measured = np.isfinite(measured_minus(observed, poses.dataset))
    lever = what_is_left(discovery.mechanism, observed, measured, lever)
    residual = what_is_left(discovery.mechanism, observed, measured, residual)
    strength = np.sum(lever**2, axis=1)
    seen = strength > 0.05 * np.max(strength, initial=1e-30)
    own = shape(final, candidate, poses.states) / site.terms[0][2]
    partial = own + np.sum(lever * residual, axis=1) / np.where(seen, strength, 1.0)
    inputs = list(dict.fromkeys(x for e in candidate.effects for x in e.inputs)) or ["row"]
    x = poses.states[inputs[0]]
    unit = poses.states.units[inputs[0]]
    x, unit = (np.degrees(x), "deg") if unit == "rad" else (x, unit)
    scale, y_unit = (1e6, "µrad") if site.axis.startswith("R") else (1e3, "mm")
    order = np.argsort(x)
    single = len(inputs) == 1
    return {
        "effect": i,
        "x_name": names.get(inputs[0], inputs[0]),
        "x_unit": unit,
        "x": x[seen].tolist(),
        "partial": (scale * partial[seen]).tolist(),
        "heldout": heldout[seen].tolist(),
        "curve_x": x[order].tolist() if single else [],
        "curve_y": (scale * own[order]).tolist() if single else [],
        "y_unit": y_unit,
    }


def _length(mm: float) -> str:
    return f"{mm:.3f} mm" if mm >= 0.02 else f"{1e3 * mm:.2f} µm"


def _verdict(report: dict[str, Any]) -> str:
    ladder = report["ladder"]
    standard, last = ladder[1]["heldout"]["rms_mm"], ladder[-1]["heldout"]["rms_mm"]
    floor = report["noise_floor_mm"]
    tail = f", noise floor {_length(floor)}" if floor is not None else ""
    if not report["effects"]:
        return (
            f"Standard model {_length(standard)} RMS on held-out poses{tail}; nothing stands out of chance: "
            "nothing was added."
        )
    parts = []
    for e in report["effects"]:
        size = wording.measured(e["value"], e["stderr"], e["unit"])
        parts.append(f"{e['name']}, {size.value} ± {size.deviation} {size.unit}")
    inputs = list(dict.fromkeys(x for e in report["effects"] for x in e["inputs"]))
    return (
        f"Standard model {_length(standard)} RMS on held-out poses; the residual depends on {', '.join(inputs)}; "
        f"added {'; '.join(parts)}; {_length(last)} RMS on held-out poses{tail}; {report['stopped']}."
    )
