"""Unmeasured poses within the measured ranges, for computing the errors of exported files."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.kinematics import with_memory_columns, with_model_labels
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched, drawn_between
from gpmodel.model.error_model import closing
from gpmodel.table.dataset import Dataset


def measured_table(saved: SavedModel) -> Dataset:
    """Return the table to which a model was fitted; raise InputError if the model does not contain the table."""
    if saved.measured is None:
        raise InputError("model: the file does not contain the table of the fit; run calibrate or discover again")
    return with_memory_columns(saved, with_model_labels(saved, saved.measured.dataset))


@dataclass(frozen=True)
class Place:
    """Set-up and tool of an exported file. tip: with several arms, the measured link of the tool; else empty."""

    setup: str
    tool: str
    tip: str = ""

    @classmethod
    def of(cls, saved: SavedModel, setup: str | None = None, tool: str | None = None) -> "Place":
        """Return the set-up and tool with given names, by default the first; raise InputError for an unknown name."""
        placed = saved.placement
        chosen = _named(placed.tool, tool, "tool")
        return cls(_named(placed.registration, setup, "setup"), chosen, tips_of(saved).get(chosen, ""))

    def poses(self, data: Dataset) -> Dataset:
        """Return a dataset with all rows labelled by the export's set-up and tool."""
        here = {"setup": np.full(len(data), self.setup), "tool": np.full(len(data), self.tool)}
        if self.tip:
            here["tip"] = np.full(len(data), self.tip)
        return replace(data, labels={**data.labels, **here})

    def label(self, saved: SavedModel) -> str:
        """Name set-up and tool of an export in a sentence; empty if the model has one set-up and one tool."""
        placed = saved.placement
        own = (("Set-up", self.setup, placed.registration), ("Tool", self.tool, placed.tool))
        return " ".join(f"{what} {name}, one of {', '.join(all_)}." for what, name, all_ in own if len(all_) > 1)


def tips_of(saved: SavedModel) -> dict[str, str]:
    """Return the measured link of each tool whose rows have a single link; empty for a single arm."""
    tree = branched(saved.mechanism)
    if tree is None or saved.measured is None:
        return {} if tree is None else {tip: tip for tip in tree.tips if tip in saved.placement.tool}
    data = saved.measured.dataset
    both = {*zip(data.label("tool").tolist(), data.label("tip").tolist(), strict=True)}
    on: dict[str, set[str]] = {}
    for tool, tip in both:
        on.setdefault(tool, set()).add(tip or next(iter(tree.tips)))
    return {tool: tips.pop() for tool, tips in on.items() if len(tips) == 1}


def _named(known: Mapping[str, object], name: str | None, argument: str) -> str:
    if name is None:
        return next(iter(known))
    if name not in known:
        said = ", ".join(repr(k) for k in known if k) or "none: it has one without a name"
        raise InputError(f"'{name}' is unknown to the model, expected {said}", argument)
    return name


def fresh_poses(saved: SavedModel, count: int, rng: np.random.Generator) -> Dataset:
    """Draw `count` poses, with joint values uniform over the measured ranges and other inputs of random rows.

    Poses are left out if loops do not close with the fitted errors. Raises InputError without a measured table.
    """
    data = measured_table(saved)
    q = drawn_between(saved.mechanism, data.q.min(axis=0), data.q.max(axis=0), count, rng)
    drawn = at_joint_values(data, q, rng)
    return drawn.subset(closing(saved.model, drawn, saved.theta))


def at_joint_values(data: Dataset, q: Array, rng: np.random.Generator) -> Dataset:
    """Return unmeasured poses at joint values q, with other inputs from random rows of `data`."""
    rows = rng.integers(0, len(data), len(q))
    blank = np.full((len(q), 3), np.nan)
    taken = data.subset(rows)
    return replace(taken, q=q, position=blank, rotation=blank.copy(), distances={}, in_order=False)
