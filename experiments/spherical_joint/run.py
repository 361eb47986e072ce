"""Repeat Tables 3.4, 3.5 and Figures 3.18, 3.19, 3.29 (4.30), 5.13, 5.14, 5.16 on simulated rigs.

From the root of the repository: python -m experiments.spherical_joint.run
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.spherical_joint.reductions import JOINT, RIG, reduction, summary, tables
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.loop import discover
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.report.from_discovery import from_discovery
from gpmodel.report.origin import Origin, versions
from gpmodel.report.saved import as_dict
from gpmodel.table.blocks import hold_out
from joints.budget import KINDS, budget_joint, error_budget, read_budget
from joints.studies.budget import budget_chart
from joints.studies.contact import contact_chart, contact_types

MICRO = 1e6


def referenced_chart(figure: Figure, histogram: Mapping[str, Any]) -> None:
    """Inputs that the evolved programs reference, with those of searches on shuffled residuals (Fig 5.13)."""
    ax = figure.subplots()
    at = np.arange(len(histogram["inputs"]))
    for k, name in enumerate(("linear", "tree", "shuffled")):
        ax.bar(at + 0.26 * (k - 1), histogram[name], 0.24, label=name)
    ax.set_xticks(at, histogram["inputs"])
    ax.set(ylabel="runs that reference it", title="Referenced inputs")
    ax.legend()


def compensation_chart(figure: Figure, shape: Mapping[str, Any], axis: str) -> None:
    """The translation found on the pitch axis over J1, and as an offset in y of the socket's frame (Fig 5.14).

    shape: a report's plot of the effect. axis: Ty or Tz, of the frame that turns with J1.
    """
    left, right = figure.subplots(1, 2)
    turn = np.radians(shape["curve_x"])
    curve = 1e3 * np.array(shape["curve_y"])
    left.plot(shape["x"], 1e3 * np.array(shape["partial"]), ".", color="0.6", label="measured less the rest")
    left.plot(shape["curve_x"], curve, label="found")
    left.set(xlabel="J1 [deg]", ylabel=f"{axis} of the pitch axis [µm]", title="Effect found over J1")
    left.legend()
    right.plot(shape["curve_x"], curve * (np.cos(turn) if axis == "Ty" else -np.sin(turn)))
    right.set(xlabel="J1 [deg]", ylabel="offset in y [µm]", title="The same as a y-coordinate offset")


def distribution_chart(figure: Figure, errors: Mapping[str, Array]) -> None:
    """Errors on poses held out, model by model, in shared bins (Fig 5.16). errors: m."""
    ax = figure.subplots()
    edges = np.linspace(0.0, MICRO * max(e.max() for e in errors.values()), 16)
    for name, error in errors.items():
        label = f"{name}: mean {MICRO * error.mean():.2f}, max {MICRO * error.max():.1f} µm"
        ax.hist(MICRO * error, bins=edges.tolist(), histtype="step", linewidth=1.8, label=label)
    ax.set(xlabel="error on held-out poses [µm]", ylabel="poses", title="Accuracy distribution")
    ax.legend()


HERE = Path(__file__).parent
COMMAND = "python -m experiments.spherical_joint.run"
PUBLISHED_BUDGET = {"systematic": 10e-6, "stochastic": 0.1e-6}


def draw(name: str, chart: Callable[..., None], *numbers: Any, width: float = 7.0) -> None:
    figure = Figure(figsize=(width, 4.0), layout="constrained")
    chart(figure, *numbers)
    figure.savefig(HERE / "figures" / f"{name}.png", dpi=110, metadata={"Software": None})


def budgets() -> dict[str, Any]:
    sources, settings = read_budget()
    out = {}
    for kind in KINDS:
        started = time.perf_counter()
        found = error_budget(budget_joint(JOINT, settings), sources, kind, np.random.default_rng(0))
        seconds = time.perf_counter() - started
        out[kind] = {"mean_um": 1e6 * found.mean, "mean_plus_3sd_um": 1e6 * found.worst_case, "seconds": seconds}
        draw(f"budget_{kind}", budget_chart, found, PUBLISHED_BUDGET[kind], width=12.0)
    return out


def improvement() -> dict[str, Any]:
    """Section 5.3: a pitch axis whose eccentricity varies with J1, undeclared; the loop, and an oracle told of it."""
    rng = np.random.default_rng(0)
    rig = replace(RIG, reach=(1.5, 1.2, 1.5))
    data = rig.measure(rig.poses(90, rng), rng, disturbance=lambda q, extras: {14: 20e-6 * np.sin(q[:, 0])})
    poses, (train, heldout) = prepare(JOINT, data), hold_out(data, 0.3, np.random.default_rng(0))
    found = discover(JOINT, poses, train, heldout)
    report = as_dict(from_discovery(found, Origin(COMMAND, 0, found.seconds)))
    told = effect_at("told", "J1.moving", "Ty", Expression("sin(J1)"))
    oracle = calibrate(ErrorModel(JOINT, (*geometric_effects(JOINT), told)), poses.subset(train))
    rungs = {"sphere fit": found.steps[0], "standard model": found.steps[1], "with what was found": found.steps[-1]}
    draw("fig_5_13_referenced_inputs", referenced_chart, report["histogram"])
    shape, axis = report["plots"]["shapes"][0], report["effects"][0]["axis"]
    draw("fig_5_14_compensation", compensation_chart, shape, axis, width=11.0)
    draw("fig_5_16_distribution", distribution_chart, {n: s.heldout_error for n, s in rungs.items()})
    heldout_rows = {n: summary(s.heldout_error) for n, s in rungs.items()}
    heldout_rows["oracle told the effect"] = summary(errors_on(oracle, poses.subset(heldout)))
    return {
        "heldout": heldout_rows,
        **{key: report[key] for key in ("effects", "verdict", "histogram", "unobservable")},
    }


if __name__ == "__main__":
    (HERE / "figures").mkdir(exist_ok=True)
    draw("contact_types", contact_chart, contact_types())
    results = {
        "command": COMMAND,
        "versions": versions(),
        "tables": tables(20),
        "reduction": reduction(),
        "budget": budgets(),
        "improvement": improvement(),
    }
    (HERE / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
