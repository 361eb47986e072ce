"""Constants that no machine of this description has, or that miss the very poses they were fitted to: such a model was
changed, whoever sealed it."""

import numpy as np

from gpmodel.application.measured import Measured
from gpmodel.arrays import Array
from gpmodel.calibration.unmeasured_joints import solve_joints
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.workspace import length_at_probe
from gpmodel.model.error_model import ErrorModel, Placement, observe, pose_error, prepare

FARTHEST, TURN = 1.0, np.pi
"""Metres that a constant may be off where the links together are shorter, and radians: what is more is another
machine."""
SHARE = 0.25
"""Of the mechanism's length, or of FARTHEST, that a fit leaves at half of its poses at most: a robot measured with its
joints in the wrong order leaves as much."""
ROWS = 60
"""Poses of its own that a model is held against: its constants are the same at all."""


def check_constants(model: ErrorModel, theta: Array, placement: Placement, measured: Measured | None) -> None:
    """Raises InputError for a constant error larger than the machine; and where the model misses the poses that it was
    fitted to by SHARE of its length, or does not know their set-ups and tools.

    Where a second arm stands is no error.
    """
    length = max(FARTHEST, length_at_probe(model.mechanism))
    most = {"m": length, "rad": TURN}
    for k, (effect, value) in enumerate(zip(model.effects, theta, strict=True)):
        off = abs(value) * max(abs(term.weight) for term in effect.terms)
        if effect.constant and not branched(model.mechanism) and off > most.get(effect.unit, np.inf):
            raise InputError(
                f"effects[{k}].value: '{effect.name}' is {value:g} {effect.unit}; expected at most "
                f"{most[effect.unit]:.3g} {effect.unit}, beyond which it is another machine"
            )
    if measured is None or not len(rows := measured.training[:ROWS]):
        return
    dataset = measured.dataset.subset(rows)
    for column, known in (("setup", placement.registration), ("tool", placement.tool)):
        if surplus := sorted({*dataset.label(column).tolist()} - known.keys()):
            raise InputError(f"measured.labels: {column} '{surplus[0]}'; expected one of those of the model")
    with np.errstate(all="ignore"):
        poses = solve_joints(model, prepare(model.mechanism, dataset), theta, placement)
        miss = float(np.nanmedian(pose_error(observe(model, poses, theta, placement), dataset)))
    if not miss <= SHARE * length:
        raise InputError(
            f"its constants miss half of the poses they were fitted to by {miss:.3g} m or more; expected at most "
            f"{SHARE * length:.3g} m, beyond which it is another machine"
        )
