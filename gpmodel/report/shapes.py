"""Shape of a finding: its partial residual over its first input."""

from collections.abc import Mapping

import numpy as np

from gpmodel.arrays import Mask
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.calibration.unmeasured_joints import what_is_left
from gpmodel.families.candidate import Candidate
from gpmodel.mechanism.protocol import AXES, places
from gpmodel.model.error_model import Poses, measured_minus, observe
from gpmodel.report.fitted import finite
from gpmodel.report.quantity import shape
from gpmodel.report.schema_poses import ShapeRecord

WEAK = 0.05
"""A pose where a unit twist moves the point by less than √0.05 = 22 % of the most says too little to be drawn."""


def shape_record(
    final: Calibration, poses: Poses, candidate: Candidate, heldout: Mask, names: Mapping[str, str]
) -> ShapeRecord | None:
    """Own contribution plus what the final model leaves along its column, pose by pose; None where it is not enabled.

    partial = θ φ + l·r / l·l,  l: what the measured components move per unit of the twist, r: their residual, all
    weighted as in the fit.
    """
    mechanism = final.model.mechanism
    poses = resolved(final, poses)
    if not {e.name for e in candidate.effects} <= {e.name for e in final.model.effects}:
        return None
    observed = observe(final.model, poses, final.theta, final.placement)
    difference = measured_minus(observed, poses.dataset)
    measured, residual = np.isfinite(difference), np.nan_to_num(difference)
    weights = measured * observed.scales(final.rotation_weight)
    term = candidate.place
    sensitivity = observed.sensitivity(places(mechanism).index(term.slot))
    column = sensitivity[:, :, AXES.index(term.axis)] * term.weight
    column, residual = (what_is_left(mechanism, observed, measured, weights * v) for v in (column, residual))
    strength = np.sum(column**2, axis=1)
    seen = strength > WEAK * np.max(strength, initial=1e-30)
    own = shape(final, candidate, poses.states) / term.weight
    partial = own + np.sum(column * residual, axis=1) / np.where(seen, strength, 1.0)
    read = term.basis.inputs if candidate.kind == "single" else candidate.inputs
    inputs = tuple(read) or ("row",)
    x, unit = poses.states[inputs[0]], poses.states.unit(inputs[0])
    x, unit = (np.degrees(x), "deg") if unit == "rad" else (x, unit)
    scale, y_unit = (1e6, "µrad") if term.axis.startswith("R") else (1e3, "mm")
    order = np.argsort(x) if len(inputs) == 1 else np.zeros(0, dtype=int)
    return ShapeRecord(
        effect=0,
        x_name=names.get(inputs[0], inputs[0]),
        x_unit=unit,
        y_unit=y_unit,
        x=finite(x[seen]),
        partial=finite(scale * partial[seen]),
        heldout=tuple(heldout[seen].tolist()),
        rows=tuple(poses.dataset.row[seen].tolist()),
        curve_x=finite(x[order]),
        curve_y=finite(scale * own[order]),
    )
