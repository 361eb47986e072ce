"""Saved reports as `gpmodel discover` leaves them, made from planted numbers; and poorer ones."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
JOINTS = [f"J{i}" for i in range(1, 7)]
INPUTS = [*JOINTS, "x", "y", "z", "torque_J2", "torque_J3", "moment_base_x", "temperature", "row"]
DROPPED = ["J1 Tz", "J2 Tz", "J6 Tz"]


def found(seed: int = 0) -> dict[str, Any]:
    """A robot with a gear error in J4 and a compliance in J2, both found."""
    return _report(seed, effects=2)


def nothing(seed: int = 0) -> dict[str, Any]:
    """A robot with nothing undeclared."""
    return _report(seed, effects=0)


def many(seed: int = 0) -> dict[str, Any]:
    """Seven effects, 600 poses, no poses held out by row order, long names."""
    return _report(seed, effects=7, poses=600)


def sparse() -> dict[str, Any]:
    """Only what the contract promises, and empty where it may be."""
    empty = {"mean_mm": None, "rms_mm": None, "max_mm": None}
    rung = {"mean_mm": 0.2, "rms_mm": 0.25, "max_mm": 0.6}
    return {
        "schema": 1,
        "command": "gpmodel calibrate cell.csv --mechanism ur5 --holdout 0",
        "versions": {},
        "seed": 0,
        "data": {"file": "cell.csv", "sha256": "0" * 64, "poses": 30, "train": 30, "heldout": 0, "outliers": []},
        "mechanism": {"name": "ur5", "joints": JOINTS},
        "ladder": [{"step": "registration", "train": rung, "heldout": empty}],
        "effects": [],
        "histogram": {"inputs": [], "linear": [], "tree": [], "shuffled": [], "significant": []},
        "noise_floor_mm": None,
        "verdict": "error on the poses fitted to: 0.2500 mm RMS",
        "seconds": 0.4,
    }


def _statistics(error: Array) -> dict[str, float]:
    return {"mean_mm": error.mean(), "rms_mm": np.sqrt(np.mean(error**2)), "max_mm": error.max()}


def _effects(count: int) -> list[dict[str, Any]]:
    gear = {
        "name": "gear error, 2 per turn, J4", "slot": "J4.moving", "axis": "Rx", "basis": "sin(2*J4 +0.412)",
        "inputs": ["J4"], "value": 2.51e-4, "stderr": 4.2e-6, "unit": "rad", "unique_share": 0.93,
        "found_by": "evolved",
        "catalogue": "gear_harmonic", "explanation": "two cycles a turn: oval gear or flexspline (Tuttle 1992)",
        "rivals": [{"name": "gear error, 2 per turn, J6", "cv_rms_mm": 0.071}],
        "correlated_with": [{"name": "J4 Rx", "correlation": -0.42}], "cv_rms_mm": 0.048, "cv_before_mm": 0.117,
        "p_value": 0.005, "gain": 0.83, "sign_stable": True, "round": 1, "heldout_rms_mm": 0.049,
    }  # fmt: skip
    spring = {
        "name": "joint compliance, J2", "slot": "J2.moving", "axis": "Rz", "basis": "torque_J2",
        "inputs": ["torque_J2"],
        "value": 4.83e-8, "stderr": 2.1e-9, "unit": "rad/Nm", "unique_share": 0.31, "found_by": "evolved",
        "catalogue": "joint_compliance",
        "explanation": "gearbox and structure twist about the joint under its gravity torque (Dumas 2011)",
        "rivals": [{"name": "balancing spring, J2", "cv_rms_mm": 0.0341},
                   {"name": "base compliance", "cv_rms_mm": 0.0356}],
        "correlated_with": [{"name": "J2 Ry", "correlation": 0.81}], "cv_rms_mm": 0.0329, "cv_before_mm": 0.048,
        "p_value": 0.005, "gain": 0.52, "sign_stable": True, "round": 2, "heldout_rms_mm": 0.034,
    }  # fmt: skip
    odd = {
        "name": "(J1*J3 - 0.25)*sin(J5)/(1.3 + temperature**2) at J5.moving Ty", "slot": "J5.moving", "axis": "Ty",
        "basis": "(J1*J3 - 0.25)*sin(J5)/(1.3 + temperature**2)", "inputs": ["J1", "J3", "J5", "temperature"],
        "value": -1.2e-5, "stderr": 3e-6, "unit": "m", "unique_share": None, "found_by": "evolved", "catalogue": None,
        "explanation": "matches no named effect", "rivals": [], "latex": "", "sign_stable": None,
    }  # fmt: skip
    return [*[gear, spring][:count], *[dict(odd) for _ in range(count - 2)]]


def _shapes(effects: list[dict[str, Any]], heldout: Array, rng: np.random.Generator) -> list[dict[str, Any]]:
    shapes = []
    for i, effect in enumerate(effects):
        n = len(heldout)
        angle = rng.uniform(-170, 170, n)
        curve = 251 * np.sin(np.radians(2 * angle) + 0.412) if i == 0 else 0.6 * angle
        single = len(effect["inputs"]) == 1
        order = np.argsort(angle)
        shapes.append(
            {
                "effect": i, "x_name": effect["inputs"][0], "x_unit": "deg" if i != 1 else "Nm",
                "x": angle.tolist(), "partial": (curve + rng.normal(0, 25, n)).tolist(), "heldout": heldout.tolist(),
                "curve_x": angle[order].tolist() if single else [], "curve_y": curve[order].tolist() if single else [],
                "y_unit": "µrad",
            }
        )  # fmt: skip
    return shapes


def _histogram(peaks: tuple[str, ...], rng: np.random.Generator) -> dict[str, Any]:
    n = len(INPUTS)
    linear, tree, shuffled = rng.integers(0, 3, n), rng.integers(0, 2, n), rng.integers(0, 4, n)
    for name in peaks:
        linear[INPUTS.index(name)], tree[INPUTS.index(name)] = 6, 6
    return {
        "inputs": INPUTS, "linear": linear.tolist(), "tree": tree.tolist(), "shuffled": shuffled.tolist(),
        "p_values": [0.004 if name in peaks else 0.6 for name in INPUTS], "significant": list(peaks),
    }  # fmt: skip


def _round(number: int, winner: dict[str, Any] | None, rng: np.random.Generator) -> dict[str, Any]:
    losers = [
        ("base compliance", "base", "Rx", "moment_base_x", "catalogue", "base_compliance"),
        ("eccentricity, 1 per turn, J3", "J3.moving", "Rz", "sin(J3)", "catalogue", "eccentricity"),
        ("x*cos(J6)*J2 at J6.moving Ty", "J6.moving", "Ty", "x*cos(J6)*J2", "evolved", None),
        ("set-up moved after row 41, Tz", "base", "Tz", "step(row - 41.5)", "catalogue", "set_up_step"),
    ]
    tried: list[dict[str, Any]] = [
        {
            "name": name, "slot": slot, "axis": axis, "basis": basis, "inputs": [], "gain": 0.05 / (i + 1),
            "nats": 1.5 - 2.0 * i, "cv_rms_mm": 0.05 + 0.001 * i, "found_by": by, "catalogue": family,
            "p_value": 0.2 + 0.2 * i,
            "accepted": False, "why": f"chance of it on shuffled residuals {0.2 + 0.2 * i:.2g}, limit 0.01",
        }
        for i, (name, slot, axis, basis, by, family) in enumerate(losers)
    ]  # fmt: skip
    if winner:
        keys = ("name", "slot", "axis", "basis", "inputs", "found_by", "catalogue")
        first = {k: winner[k] for k in keys} | {
            "gain": 0.83, "nats": 71.0, "cv_rms_mm": 0.048, "p_value": 0.005, "accepted": True,
            "why": "removes 83 % of the residual energy, p 0.005",
        }  # fmt: skip
        tried.insert(0, first)
    null = rng.gumbel(-2.0, 1.5, 24).tolist()
    return {"round": number, "candidates": tried, "null_nats": null, "dropped": []}


def _parameters(rng: np.random.Generator) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = []
    for joint in JOINTS:
        for axis in ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz"):
            name, length = f"{joint} {axis}", axis.startswith("T")
            kept = name not in DROPPED
            scale = 3e-4 if length else 4e-4
            out.append(
                {
                    "name": name, "value": rng.normal(0, scale) if kept else 0.0,
                    "stderr": abs(rng.normal(0, scale / 15)) if kept else None, "unit": "m" if length else "rad",
                    "unique_share": rng.uniform(0.05, 0.9) if kept else None,
                    "correlated_with": [{"name": "J2 Rz", "correlation": 0.91}] if rng.random() < 0.3 else [],
                    "kept": kept,
                }
            )  # fmt: skip
    return out


def _report(seed: int, effects: int, poses: int = 90) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    heldout = np.zeros(poses, dtype=bool)
    heldout[rng.permutation(poses)[: int(0.3 * poses)]] = True
    points = rng.uniform((900, -900, 400), (1900, 900, 1800), (poses, 3))
    final = rng.normal(0, 0.018, (poses, 3))
    final[11] += (0.16, -0.05, 0.09)
    wave = np.sin(points[:, 1] / 250.0)
    standard = final + (np.column_stack([0.02 * wave, 0.08 * wave, 0.11 * wave]) if effects else 0.0)
    residuals = [rng.normal(0, 1.0, (poses, 3)), standard]
    residuals += [standard + (final - standard) * (i + 1) / effects for i in range(effects)]
    names = ["registration", "standard", *(f"effect {i + 1}" for i in range(effects))]
    errors = [np.linalg.norm(r, axis=1) for r in residuals]
    ladder: list[dict[str, Any]] = []
    for i, (name, error) in enumerate(zip(names, errors, strict=True)):
        ladder.append(
            {"step": name, "train": _statistics(error[~heldout]), "heldout": _statistics(error[heldout]),
             "rank": 0 if i == 0 else 26 + i, "dropped": DROPPED if i else []} | ({"effect": i - 2} if i > 1 else {})
        )  # fmt: skip
    found_effects = _effects(effects)
    peaks = [("J4",), ("torque_J2",), ()] if effects else [()]
    before, after = ladder[1]["heldout"]["rms_mm"], ladder[-1]["heldout"]["rms_mm"]
    verdict = (
        f"Standard model {before:.3f} mm RMS on held-out poses; the residual depends on J4, torque_J2; added "
        f"{'; '.join(e['name'] for e in found_effects)}; {after:.3f} mm RMS on held-out poses, noise floor 0.031 mm."
        if effects
        else f"Standard model {before:.3f} mm RMS on held-out poses, noise floor 0.031 mm; nothing stands out of chance"
        ": nothing was added."
    )
    limits = [10, 20, 50, 100, 300, 1000, 10000]
    return {
        "schema": 1,
        "command": "gpmodel discover measured.csv --mechanism irb6400r --payload 60kg --out results",
        "versions": {"python": "3.12.4", "gpmodel": "0.1.0", "numpy": "2.4.6"},
        "seed": seed,
        "data": {"file": "measured.csv", "sha256": "9f2c" * 16, "poses": poses, "train": int((~heldout).sum()),
                 "heldout": int(heldout.sum()), "outliers": [12]},
        "mechanism": {"name": "irb6400r", "joints": JOINTS},
        "ladder": ladder,
        "effects": found_effects,
        "histogram": _histogram(peaks[0], rng),
        "histograms": [_histogram(p, rng) for p in peaks],
        "rounds": [_round(i + 1, e, rng) for i, e in enumerate([*found_effects[:2], None])],
        "parameters": _parameters(rng),
        "rank_curve": [{"condition_limit": c, "rank": r, "cv_rms_mm": e} for c, r, e in zip(
            limits, (14, 19, 24, 26, 27, 27, 30), (0.41, 0.2, 0.131, 0.12, 0.118, 0.118, 0.139), strict=True)],
        "status": "converged",
        "reason": "the last step moved no point by more than a nanometre",
        "stopped": "nothing else stands out of chance",
        "noise_floor_mm": 0.031,
        "plots": {
            "error_mm": {n: {"train": e[~heldout].tolist(), "heldout": e[heldout].tolist()}
                         for n, e in zip(names, errors, strict=True)},
            "points_mm": points.tolist(),
            "heldout_mask": heldout.tolist(),
            "residual_mm": {"standard": standard.tolist(), "final": residuals[-1].tolist()},
            "shapes": _shapes(found_effects, heldout, rng),
        },
        "verdict": verdict,
        "seconds": 41.3,
    }  # fmt: skip
