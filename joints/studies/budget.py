"""`gpmodel joint budget`: the Monte Carlo error budget of the joint's kinematics."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from joints import figures, spherical_joint
from joints.budget import KINDS, Budget, budget_joint, error_budget, read_budget
from joints.passive_joint import parameter
from joints.studies.study import MICRO, Study, Table

HEADS = ("kind", "mean [um]", "mean + 3 SD [um]", "published [um]", "realigned [um]")
EVERY = 10
"""Realignment of the joint uses every tenth random draw. Realigning all draws would take thirty times as long and
change the result by a hundredth."""
REALIGNED = "realigned: the ball is held, and the angles turn to where it strains least"
PUBLISHED = {"systematic": 10e-6, "stochastic": 0.1e-6}


def budget_study(path: Path | None = None, seed: int = 0) -> Study:
    """Make Figures 3.18 and 3.19: distribution of the position error, its mean + 3 SD, and shares of the sources."""
    sources, settings = read_budget(path)
    joint = budget_joint(spherical_joint(), settings)
    kinds = [kind for kind in KINDS if any(s.kind == kind for s in sources)]
    found = {
        kind: error_budget(joint, sources, kind, np.random.default_rng(seed), settings["poses"], settings["draws"])
        for kind in kinds
    }
    settled = {kind: b.realigned(settings["realign"], EVERY) for kind, b in found.items()}
    totals = [
        (kind, b.mean * MICRO, b.worst_case * MICRO, PUBLISHED[kind] * MICRO, settled[kind].worst_case * MICRO)
        for kind, b in found.items()
    ]
    shares = [
        (kind, parameter(s.index).name, s.source, 100 * share)
        for kind, b in found.items()
        for s, share in zip(b.sources, b.shares, strict=True)
    ]
    return Study(
        tables=(
            Table("Position error", HEADS, totals, REALIGNED),
            Table("Share of the mean square", ("kind", "parameter", "source", "share [%]"), shares),
        ),
        data={
            kind: {
                "mean_um": b.mean * MICRO,
                "mean_plus_3sd_um": b.worst_case * MICRO,
                "realigned_um": settled[kind].worst_case * MICRO,
                "shares": {
                    f"{parameter(s.index).name}: {s.source}": x for s, x in zip(b.sources, b.shares, strict=True)
                },
            }
            for kind, b in found.items()
        },
        figures={
            f"budget_{kind}.png": figures.drawn(12.0, budget_chart, b, PUBLISHED[kind]) for kind, b in found.items()
        },
    )


def budget_chart(figure: Figure, budget: Budget, published: float) -> None:
    """Plot the distribution of the position error, the value `published` [m], and the share of every error source."""
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
