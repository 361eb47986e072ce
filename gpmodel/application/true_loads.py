"""Search for effects under fitted loads, if the declared payload or gravity direction does not fit the residual."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gpmodel.application.other_loads import OtherLoads, compliances, other_loads
from gpmodel.arrays import IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.state import Discovery, FinalFit, Finding
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.load import mass_at_tool, moments_at_tool
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import LoadedMechanism, choice_of
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.model.states import loads_at
from gpmodel.table.blocks import FOLD_SEED


def under_true_loads(
    loop: "partial[Discovery]",
    criteria: Criteria,
    mechanism: Mechanism,
    poses: Poses,
    train: IntArray,
    heldout: IntArray,
) -> Discovery:
    """Run the search for effects; repeat it under fitted loads, and return the second result if it predicts better.

    The loads are fitted to the residual of the standard model or of findings independent of loads. The results with and
    without fitted loads are compared by their cross-validated log likelihood on training poses, less the penalties of
    their findings. The constants of the loads, which are not cross-validated, cost one nat each (Akaike 1974).
    loop: search with its settings, a function of mechanism, poses, training rows and held-out rows.
    """
    found = loop(mechanism, poses, train, heldout)
    if not isinstance(mechanism, LoadedMechanism):
        return found
    left = _last_residual(found, criteria)
    worth = _worth(left, (), found.findings)
    other = _other_loads(found, left, mechanism, worth)
    if other is None:
        return found
    again = loop(other.mechanism, prepare(other.mechanism, found.poses.dataset), found.train, found.heldout, kept=None)
    if _worth(_last_residual(again, criteria), (), again.findings) - other.constants <= worth:
        return found
    again = replace(again, loads=other.in_words, seconds=found.seconds + again.seconds)
    return _beside_payload(again) if "payload" in other.said else again


def machine_under_true_loads(mechanism: Mechanism, poses: Poses, seed: int) -> tuple[Mechanism, Poses, str]:
    """Return a machine and its poses with the loads that explain the residual of the standard model, and these loads
    in words; unchanged, with an empty text, if the declared loads explain it."""
    if not isinstance(mechanism, LoadedMechanism):
        return mechanism, poses, ""
    fit = calibrate(ErrorModel(mechanism, geometric_effects(mechanism)), poses, seed=seed)
    other = other_loads(residual_of(fit, poses, Criteria(), seed), mechanism)
    if other is None:
        return mechanism, poses, ""
    return other.mechanism, prepare(other.mechanism, poses.dataset), other.in_words


def _last_residual(found: Discovery, criteria: Criteria) -> Residual:
    """Return the residual of the model with all findings at the training poses."""
    return residual_of(found.steps[-1].calibration, found.poses.subset(found.train), criteria, FOLD_SEED)


def _other_loads(found: Discovery, left: Residual, mechanism: LoadedMechanism, worth: float) -> OtherLoads | None:
    """Return the fitted loads with the best cross-validated predictions, or None if the declared loads predict better.

    Loads are fitted to the residual of the standard model, and to the residual of the findings that are independent of
    loads. For each set of loads, the compliances of all joints and of the base are estimated together with the
    findings, without a penalty. A model with fitted loads must predict better than the model with declared loads, and
    better than the model with all findings.
    left: residual of the model with all findings. worth: log likelihood of the model less penalties, nats.
    """
    poses = found.poses.subset(found.train)
    loads = poses.states.loads | mechanism.unit_loads(poses.dataset.q).keys()
    independent = [f for f in found.findings if all(loads.isdisjoint(e.inputs) for e in f.candidate.effects)]
    kept = {e.name for f in independent for e in f.candidate.effects}
    following = [e for f in found.findings for e in f.candidate.effects if e.name not in kept]
    residuals = [left.without(following) if following else left]
    if found.findings:
        residuals.insert(0, residual_of(found.steps[1].calibration, poses, left.criteria, FOLD_SEED))

    def reached(changed: LoadedMechanism, constants: int) -> float:
        true = loads_at(changed, poses.dataset)
        return _worth(residuals[-1], compliances(mechanism, true, len(poses)), independent) - constants

    fitted = [other for other in (other_loads(residual, mechanism) for residual in residuals) if other is not None]
    if not fitted:
        return None
    worths = [reached(other.mechanism, other.constants) for other in fitted]
    best = int(np.argmax(worths))
    return fitted[best] if worths[best] > max(worth, reached(mechanism, 0)) else None


def _worth(residual: Residual, effects: Sequence[Effect], findings: Sequence[Finding]) -> float:
    """Return the log likelihood of cross-validated predictions, less the penalties of findings, nats.

    residual: residual of a model with the findings, to which `effects` are fitted without a penalty.
    """
    price = sum(f.candidate.cost + residual.criteria.minimum_nats for f in findings)
    return -residual.measured * math.log(cross_validated(residual, effects).rms) - price


def _beside_payload(found: Discovery) -> Discovery:
    """Include the standard errors of a fitted payload in all standard errors of a search result.

    Corrections of mass and first moments of the payload are unknowns with the value zero.
    """
    if not found.findings:
        return found
    fit, poses = found.found, found.poses
    effects, carried = fit.model.effects, abs(choice_of(found.mechanism).added_mass or 1.0)
    there = found.mechanism, poses.states, effects, fit.theta
    mass = mass_at_tool(*there, np.zeros(3))
    loads = (*((mass,) if mass else ()), *moments_at_tool(*there))
    model = replace(fit.model, effects=(*effects, *(replace(load, prior=carried) for load in loads)))
    joint: Calibration = calibrate(model, poses, condition_limit=fit.condition_limit, start=fit, seed=FOLD_SEED)
    theta = np.append(fit.theta, np.zeros(len(loads)))
    joint = replace(joint, theta=theta, placement=fit.placement, error=fit.error, sigma=fit.sigma)
    fitted: FinalFit = replace(found.fitted, calibration=joint)
    return replace(found, fitted=fitted, final=joint if found.final is fit else found.final)
