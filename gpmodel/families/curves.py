"""Families that say how an error looks and not why: curves of an angle, of the rows, of a load, of any column."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gpmodel.families.angle import SMOOTH, harmonics, spectrum, wave
from gpmodel.families.candidate import Candidate, loaded, one, relative, revolute, share_of_rows
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES, Joint, Mechanism
from gpmodel.model.effect import Effect, effect_at
from gpmodel.model.sites import Site, sites_of
from gpmodel.model.states import States

FOLLOWING = (3, 1.5)
"""Harmonics of an error curve over another joint, and the harmonic at which its prior falls off. It is smoother than
that of a gear."""


def continued(curve: Candidate) -> tuple[Effect, ...]:
    """Return further harmonics, as many again as a fine curve has, with prior standard deviations falling as k^-1.5.

    Empty for effects of any other kind.
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
    """Harmonics and corner of the fine curve that so many poses can carry."""
    return None if count < 100 else (20, 8.0) if count < 200 else (40, 15.0)


def curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Error curve of the own angle on the drive, smooth and fine."""
    fine = richest(len(states))
    for j in revolute(mechanism):
        drive = Site(j.drive)
        name = f"error curve of the angle, {j.name}"
        yield Candidate(name, harmonics(name, drive, j.name, "joint_curve", spectrum(*SMOOTH)), "joint_curve", 4.0)
        if fine is not None:
            name = f"fine error curve of the angle, {j.name}"
            yield Candidate(name, harmonics(name, drive, j.name, "joint_curve", spectrum(*fine)), "joint_curve", 5.0)


def following(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Any place that follows another joint's angle, by three harmonics, or any further column, in proportion."""
    joints = revolute(mechanism)
    for site in sites_of(mechanism):
        for j in joints:
            if not _own(site, j):
                name = f"{site.name} following {j.name}"
                yield Candidate(
                    name, harmonics(name, site, j.name, "following", spectrum(*FOLLOWING)), "following", 7.0
                )
    yield from _following_columns(mechanism, states)


def _own(site: Site, joint: Joint) -> bool:
    return site.slot == f"{joint.name}.moving"


def wander(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """A slow wander of the set-up along the rows, by waves about where it was on average."""
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
    """A linear drift along the rows at any site."""
    for site in sites_of(mechanism):
        name = f"drift along the rows, {site.name}"
        yield one(name, site.effect(name, Expression("row"), "1/row", "session_curve"), 6.0)


def _following_columns(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    known = {j.name for j in mechanism.joints} | {"x", "y", "z", "row", "payload"} | states.loads
    for column in (c for c in states.columns if c not in known and np.ptp(states[c]) > 0):
        basis = Expression(relative(states, column, states.units[column]))
        for site in sites_of(mechanism):
            name = f"{site.name} following {column}"
            effect = site.effect(name, basis, f"1/{states.units[column]}", "following")
            yield one(name, effect, 6.5)


def compliances(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Each axis of a joint shifts under the force along it; each axis of the base turns under its own moment."""
    joints = {f"{j.name}.{side}": j.name for j in mechanism.joints for side in ("fixed", "moving")}
    for site in sites_of(mechanism):
        owner, along = joints.get(site.slot, site.slot), site.axis[0] == "T"
        load = f"{'force' if along else 'moment'}_{owner}_{site.axis[1]}"
        if loaded(states, load) and along != (owner == "base"):
            name = f"compliance of {site.name}"
            unit = "m/N" if along else "rad/Nm"
            yield one(name, site.effect(name, Expression(load), unit, "structure_compliance"), 6.0)


def all_torques(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Deflection of a joint by the torque of another joint."""
    for j in revolute(mechanism):
        for other in revolute(mechanism):
            if other is not j and loaded(states, f"torque_{other.name}"):
                name = f"compliance of {j.name} under the torque of {other.name}"
                effect = Site(j.drive).effect(name, Expression(f"torque_{other.name}"), "rad/Nm", "cross_compliance")
                yield one(name, effect, 6.5)


def load_curves(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Deflection as a loose curve of the own torque: linear, saturating, hardening, dead band."""
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
