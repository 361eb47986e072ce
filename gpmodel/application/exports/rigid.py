"""The geometry alone, fitted without the effects that a rigid description cannot hold."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpmodel.application.exports.sample import measured_table
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.usable import of_the_session, placed_now, usable
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.mechanism.protocol import INSTRUMENT
from gpmodel.model.error_model import ErrorModel, Placement, Poses, prepare
from gpmodel.model.naming import translate


@dataclass(frozen=True)
class Rigid:
    """fit: to all rows. placement: registration and tool as they are now. twists: constant error twist (6,), m and rad,
    of every slot that has one. heldout: 3-D errors on rows held out of a fit to the others, m. missing: effects left
    out, by the names of the table of the fit."""

    fit: Calibration
    placement: Placement
    twists: Mapping[str, Array]
    heldout: Array
    missing: tuple[str, ...]


def refitted(saved: SavedModel) -> Rigid:
    """The constants of the model fitted anew to the table it was fitted to, without the mechanism's other effects.

    Effects of the instrument and of the session stay beside them, so that the geometry does not take them up.
    Raises InputError as `measured_table`, or for a fit that cannot be made.
    """
    poses = prepare(saved.mechanism, measured_table(saved))
    aside = {e.name for e in of_the_session(saved)}
    kept = tuple(e for e in saved.model.effects if e.constant or e.name in aside or e.of_the_instrument)
    model = ErrorModel(saved.mechanism, kept)
    heldout = np.zeros(0)
    measured = saved.measured
    if measured is not None and len(measured.heldout):
        seen = calibrate(model, poses.subset(measured.training))
        heldout = errors_on(seen, poses.subset(measured.heldout))
    fit = calibrate(model, poses)
    values = zip(saved.model.effects, saved.theta, strict=True)
    missing = tuple(translate(e.name, saved.names) for e, value in values if e not in kept and value != 0.0)
    placement = placed_now(usable(saved_model(fit, poses))).placement
    return Rigid(fit, placement, _constant_twists(fit, poses.subset(np.arange(1))), heldout, missing)


def _constant_twists(fit: Calibration, one: Poses) -> dict[str, Array]:
    """By slot, from the states of any one pose, which constants do not read."""
    out: dict[str, Array] = {}
    for effect, value in zip(fit.model.effects, fit.theta.tolist(), strict=True):
        if effect.constant and value != 0.0:
            for slot in effect.slots:
                out[slot] = out.get(slot, np.zeros(6)) + value * effect.twist(one.states, slot)[0]
    out.pop(INSTRUMENT, None)
    return out
