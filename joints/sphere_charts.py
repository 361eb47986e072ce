"""Charts of the spherical joint's accuracy, drawn on a given figure."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gpmodel.arrays import Array
from joints.budget import Budget
from joints.contact_types import ContactType
from joints.kinematics import parameter
from joints.solution import Solution

MICRO = 1e6


def budget_chart(figure: Figure, budget: Budget, published: float) -> None:
    """Distribution of the position error and the share of every source (Figs 3.18, 3.19). published: m."""
    left, right = figure.subplots(1, 2)
    shares, edges = budget.histogram()
    left.stairs(100 * shares, MICRO * edges, fill=True, alpha=0.6)
    left.axvline(MICRO * budget.worst_case, color="C3", label=f"mean + 3 SD {MICRO * budget.worst_case:.2g} µm")
    left.axvline(MICRO * published, color="k", linestyle=":", label=f"published {MICRO * published:g} µm")
    left.set(xlabel="position error [µm]", ylabel="share of the draws [%]", title=f"{budget.kind} errors")
    left.legend()
    names = [f"{parameter(s.index).name}: {s.source}" for s in budget.sources]
    right.barh(names, [100 * s for s in budget.shares])
    right.invert_yaxis()
    right.set(xlabel="share of the mean square [%]", title="whose fault")


def contact_chart(figure: Figure, types: Sequence[ContactType]) -> None:
    """Largest residual of every prototype, predicted and before and after calibration (Figs 3.29, 4.30)."""
    ax = figure.subplots()
    at = np.arange(len(types))
    for k, (name, key) in enumerate(
        (("predicted", "predicted_max"), ("sphere fit", "sphere_fit_max"), ("calibrated", "calibrated_max"))
    ):
        values = [getattr(t, key) for t in types]
        ax.bar(at + 0.26 * (k - 1), [0.0 if v is None else MICRO * v for v in values], 0.24, label=name)
        for i, value in enumerate(values):
            label = "not printed" if value is None else f"{MICRO * value:g}"
            ax.annotate(label, (i + 0.26 * (k - 1), 0.0 if value is None else MICRO * value), ha="center", va="bottom",
                        rotation=90 if value is None else 0, fontsize="small")  # fmt: skip
    ax.set_xticks(at, [t.name for t in types])
    ax.set(ylabel="largest residual [µm]", title="Published accuracy of the prototypes")
    ax.legend()


def convergence_chart(figure: Figure, solutions: Mapping[str, Solution]) -> None:
    """Distance still moved in each iteration of the solvers."""
    ax = figure.subplots()
    for name, solution in solutions.items():
        moved = [MICRO * p.moved for p in solution.history]
        ax.loglog(range(1, len(moved) + 1), moved, ".-", label=f"{name}: {len(moved)} iterations, {solution.status}")
    ax.set(xlabel="iteration", ylabel="largest motion [µm]", title="Free angles: two solvers, one answer")
    ax.legend()


def referenced_chart(figure: Figure, histogram: Mapping[str, Any]) -> None:
    """Inputs that the evolved programs reference, beside the search on shuffled residuals (Fig 5.13)."""
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
