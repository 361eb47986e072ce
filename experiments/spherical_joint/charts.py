"""Charts of what is found on the simulated rigs, drawn on a given figure."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gpmodel.arrays import Array

MICRO = 1e6


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
