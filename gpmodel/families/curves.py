"""Families of smooth functions of an angle, the row number, a load or an input column, which name no cause."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gpmodel.families.angle import SMOOTH, harmonics, spectrum, wave
from gpmodel.families.candidate import Candidate, loaded, one, relative, revolute, share_of_rows
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.effect import Effect, axis_unit, effect_at
from gpmodel.model.sites import Site, sites_of
from gpmodel.model.states import States

FOLLOWING = (3, 1.5)
"""Number of harmonics of an error that depends on another joint's angle, and the harmonic from which the prior falls
off. An error over the angle of another joint is smoother than the error of a gear."""


def continued(curve: Candidate) -> tuple[Effect, ...]:
    """Return further harmonics for a detailed angular error, with prior standard deviations falling as k^-1.5.

    k: number of a harmonic. Only a detailed angular error gets further harmonics.
    """
    count, last = len(curve.effects) // 2, curve.effects[-1]
    if count <= SMOOTH[0] or len(curve.inputs) > 1 or last.terms[0].basis != wave("cos", count, curve.inputs[0]):
        return ()
    return tuple(
        replace(
            last,
            name=f"{curve.name}, {f} {k}",
            terms=tuple(replace(t, basis=wave(f, k, curve.inputs[0])) for t in last.terms),
            prior=last.prior * (count / k) ** 1.5,
        )
        for k in range(count + 1, 2 * count + 1)
        for f in ("sin", "cos")
    )


def richest(count: int) -> tuple[int, float] | None:
    """Return the number of harmonics that `count` poses determine, and the harmonic from which their prior falls off.

    With fewer than 100 poses the result is None.
    """
    return None if count < 100 else (20, 8.0) if count < 200 else (40, 15.0)


def curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield a smooth and a detailed error of each revolute joint's drive as functions of its angle."""
    fine = richest(len(states))
    for j in revolute(mechanism):
        drive = Site(j.drive)
        name = f"error curve of the angle, {j.name}"
        yield Candidate(name, harmonics(name, drive, j.name, "joint_curve", spectrum(*SMOOTH)), "joint_curve", 4.0)
        if fine is not None:
            name = f"fine error curve of the angle, {j.name}"
            yield Candidate(name, harmonics(name, drive, j.name, "joint_curve", spectrum(*fine)), "joint_curve", 5.0)


def following(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield errors at each site: three harmonics of a joint's angle, or a multiple of a further column of the table.

    Harmonics of a joint's angle are not offered at the moving frame of the joint itself.
    """
    joints = revolute(mechanism)
    for site in sites_of(mechanism):
        for j in joints:
            if site.slot != f"{j.name}.moving":
                name = f"{site.name} following {j.name}"
                yield Candidate(
                    name, harmonics(name, site, j.name, "following", spectrum(*FOLLOWING)), "following", 7.0
                )
    yield from _following_columns(mechanism, states)


def wander(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield a slow drift of the robot's base over the rows of the table, as a sum of cosines of mean zero."""
    waves = [Expression(f"cos({3.14159265 * k:.8f}*{share_of_rows(states)})") for k in range(1, 7)]
    fall = spectrum(6, 1.0)
    for kind, axes in (("shift", AXES[:3]), ("turn", AXES[3:])):
        name = f"slow wander of the set-up, {kind}"
        effects = [
            Effect(f"{name} {a}, wave {k}", effect_at("", "base", a, w).terms, "m", "set_up_wander", float(s))
            for a in axes
            for k, (w, s) in enumerate(zip(waves, fall, strict=True), 1)
        ]
        yield Candidate(name, tuple(effects), "set_up_wander", 6.0)


def session(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield a linear drift over the rows of the table at each site (frame and axis)."""
    for site in sites_of(mechanism):
        name = f"drift along the rows, {site.name}"
        yield one(name, site.effect(name, Expression("row"), axis_unit(site.axis, "row"), "session_curve"), 6.0)


def _following_columns(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    known = {j.name for j in mechanism.joints} | {"x", "y", "z", "row", "payload"} | states.loads
    for column in (c for c in states.columns if c not in known and np.ptp(states[c]) > 0 and loaded(states, c)):
        basis = Expression(relative(states, column, states.units[column]))
        for site in sites_of(mechanism):
            name = f"{site.name} following {column}"
            effect = site.effect(name, basis, axis_unit(site.axis, states.units[column]), "following")
            yield one(name, effect, 6.5)


def compliances(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the shift of each joint axis under the force along it, and the tilt of the base under each moment."""
    joints = {f"{j.name}.{side}": j.name for j in mechanism.joints for side in ("fixed", "moving")}
    for site in sites_of(mechanism):
        owner, along = joints.get(site.slot, site.slot), site.axis[0] == "T"
        load = f"{'force' if along else 'moment'}_{owner}_{site.axis[1]}"
        if loaded(states, load) and along != (owner == "base"):
            name = f"compliance of {site.name}"
            unit = "m/N" if along else "rad/Nm"
            yield one(name, site.effect(name, Expression(load), unit, "structure_compliance"), 6.0)


def all_torques(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint under the torque of each other joint."""
    for j in revolute(mechanism):
        for other in revolute(mechanism):
            if other is not j and loaded(states, f"torque_{other.name}"):
                name = f"compliance of {j.name} under the torque of {other.name}"
                effect = Site(j.drive).effect(name, Expression(f"torque_{other.name}"), "rad/Nm", "cross_compliance")
                yield one(name, effect, 6.5)


def load_curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the deflection of each joint as a sum of functions of its torque: linear, saturating, hardening."""
    for j in revolute(mechanism):
        torque = f"torque_{j.name}"
        if not loaded(states, torque):
            continue
        scale = float(np.max(np.abs(states[torque])))
        load = f"{torque}/{scale:.4g}"
        texts = [f"tanh(3*({load}))", f"tanh(10*({load}))", f"abs({load})"]
        texts += [f"max({load} - {b}, 0)" for b in (0.25, 0.5)] + [f"min({load} + {b}, 0)" for b in (0.25, 0.5)]
        name = f"curve over the torque, {j.name}"
        effects: list[Effect] = [
            Site(j.drive).effect(f"{name}, {k}", Expression(t), "rad", "load_curve")
            for k, t in enumerate([load, *texts], 1)
            if np.ptp(Expression(t)(states)) > 0
        ]
        yield Candidate(name, tuple(effects), "load_curve", 6.0)
