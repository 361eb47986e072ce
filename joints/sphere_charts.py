"""Charts of the spherical joint's accuracy, drawn on a given figure."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from joints.budget import Budget
from joints.contact_types import ContactType
from joints.kinematics import parameter

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
