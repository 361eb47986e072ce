"""Weigh measured pixels or degrees relative to metres by two fits; the first estimates weights for the second."""

from dataclasses import replace

import numpy as np
from scipy import special

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation, observations
from gpmodel.model.observed import Observed
from gpmodel.model.pixel import Pixels
from gpmodel.model.sites import geometric_effects
from gpmodel.table.dataset import Readings


def hang_payload(mechanism: Mechanism, poses: Poses) -> tuple[Mechanism, Poses]:
    """Attach the payload at the tool point, estimated by a fit of registration and tool alone.

    Several tools share one centre of mass c, with the least sum of squared moment errors Σ m² |c - t|² over the poses:
    m is the payload of a pose, t its tool point. The mechanism is unchanged if a centre of mass is given, no pose has a
    payload, or it was built in Python.
    """
    if not isinstance(mechanism, LoadedMechanism) or mechanism.choice.payload_com is not None:
        return mechanism, poses
    if not np.any(poses.dataset.payload > 0):
        return mechanism, poses
    mechanism = mechanism.carrying_at(_tool_point(mechanism, poses))
    return mechanism, prepare(mechanism, poses.dataset)


def find_lever(mechanism: Mechanism, poses: Poses) -> Mechanism:
    """Extend the last link's lever to the tool point, estimated by a fit of registration and tool alone.

    Only a loaded mechanism with a lever changes; nominal frames do not change. The lever is the length that expands
    with temperature.
    """
    if not isinstance(mechanism, LoadedMechanism) or not hasattr(mechanism.bare, "reaching"):
        return mechanism
    return mechanism.reaching(_tool_point(mechanism, poses))


def _tool_point(mechanism: Mechanism, poses: Poses) -> Array:
    fit, carried = calibrate(ErrorModel(mechanism, ()), poses), poses.dataset.payload
    points = np.array([fit.placement.tool[name][:3, 3] for name in poses.dataset.label("tool").tolist()])
    return np.asarray(np.average(points, axis=0, weights=carried**2 if np.any(carried) else None))


FITS = 2
"""Number of fits that weigh measurements of different units; a fit uses weights estimated by the fit before."""
TRUSTED = 0.95
"""Share of the measurements, with the smallest residuals, from which the noise is estimated. One measurement in twenty
may be an outlier."""


def with_weights(mechanism: Mechanism, poses: Poses) -> Poses:
    """Return the poses with pixels and inclinations converted to metres.

    If the table has lengths, the factors of conversion equalise the residuals of the standard model. Without lengths in
    the table, a pixel counts as its size at the distance of the board, and a radian as one metre.
    """
    dataset = poses.dataset
    if not any(isinstance(kind, Pixels | Inclination) for kind in dataset.observations):
        return poses
    model = ErrorModel(mechanism, geometric_effects(mechanism))
    for _ in range(FITS):
        fit = calibrate(model, poses)
        observed = observe(fit.model, poses, fit.theta, fit.placement)
        spreads = {kind.name: _spread(kind, observed) for kind in observations(poses.dataset) if kind.readings.any()}
        lengths = [spreads[k.name] for k in observed.kinds if k.unit == "m" and k.name in spreads]
        counted = tuple(_counted(kind, spreads, lengths, observed) for kind in poses.dataset.observations)
        poses = replace(poses, dataset=replace(poses.dataset, observations=counted))
    return poses


def _counted(kind: Readings, spreads: dict[str, float], lengths: list[float], observed: Observed) -> Readings:
    if not isinstance(kind, Pixels | Inclination):
        return kind
    covers = next((k.depth(observed.tips, observed.own) for k in observed.kinds if isinstance(k, Pixels)), None)
    if not lengths and isinstance(kind, Pixels) and covers is not None:
        return replace(kind, metres=covers)
    if not lengths and covers is not None:
        lengths = [covers * spreads["pixel"]]
    return replace(kind, metres=min(lengths) / spreads[kind.name]) if lengths else kind


def _spread(kind: Observation, observed: Observed) -> float:
    """Return a robust standard deviation of the residuals of one instrument, in its unit, corrected for its unknowns.

    The variance is Σ |r|² / (ν F) over the rows with the smaller residuals r, with ν degrees of freedom per row and F
    the share of these rows in the sum of normal residuals. A median of components would fail: of the six components of
    a ball bar, five are fitted to zero.
    """
    left = kind.residual(observed.tips, observed.own)
    read = np.isfinite(left)
    squared = np.sort(np.nansum(left[read.any(axis=1)] ** 2, axis=1))
    free = max(int(read.sum()) - sum(len(names) for names in kind.own.values()), 1)
    each = max(free / len(squared), 1.0)
    share = special.chdtr(each + 2.0, special.chdtri(each, 1.0 - TRUSTED))
    return float(np.sqrt(np.sum(squared[: int(np.ceil(TRUSTED * len(squared)))]) / (free * share))) or 1e-12
