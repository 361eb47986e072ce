"""Comparison of a joint with its requirements: preload, contact, thermal growth, air film, stiffness, error budget."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gpmodel.errors import InputError, choices
from joints.budget import KINDS, error_budget, sources_of
from joints.contact import Body, LoopPart, first_yield_pressure, gap_growth, hertz, loop_growth
from joints.dynamics import ball_mass, magnet_stiffness
from joints.film import design_film, edge_gap, film_geometry, orifice_law
from joints.orifice import ATMOSPHERE
from joints.passive_joint import JOINTS, SECTIONS, PassiveJoint, read_joint, spherical_joint
from joints.preload import (
    MagnetRing,
    contact_directions,
    contact_forces,
    projected_area,
    socket_fixed_limit,
    three_contact_limit,
    total_preload,
)
from joints.reynolds import FedFilm, decay_per_cycle, fed_film, spherical_film
from joints.settings import Settings, laid_over, positive, read_toml
from joints.stiffness import layer_stiffness

CONTACTS = ("point", "rolling", "sliding", "fluid")
BUDGET_POSES, BUDGET_DRAWS = 40, 200
"""Numbers of poses and of random draws of an error budget, with which mean + 3 σ is known to two digits."""


@dataclass(frozen=True)
class Limit:
    """A limit of the joint, such as preload. used: required amount, and there: available amount, in `unit`."""

    topic: str
    quantity: str
    used: float
    there: float
    unit: str

    @property
    def share(self) -> float:
        """Ratio of required to available amount; above 1 the limit of the joint is exceeded."""
        return self.used / self.there


@dataclass(frozen=True)
class JointDesign:
    """A spherical joint, the settings of every engineering model, and the limits of the joint."""

    joint: PassiveJoint
    settings: dict[str, Settings]
    limits: tuple[Limit, ...]

    @property
    def governing(self) -> Limit:
        """The limit of the joint with the largest ratio of required to available amount."""
        return max(self.limits, key=lambda limit: limit.share)

    @property
    def verdict(self) -> str:
        """One sentence that names the governing limit of the joint and the exceeded limits."""
        g = self.governing
        there = f"{g.there:.3g} {g.unit}".rstrip()
        said = f"{g.topic} governs: {g.quantity}, {g.used:.3g} of {there}, {100 * g.share:.0f} %"
        missed = [limit.topic for limit in self.limits if limit.share > 1]
        return f"{said}; {'not met: ' + ', '.join(missed) if missed else 'every demand is met'}"


def read_design(path: Path | None = None) -> tuple[PassiveJoint, dict[str, Settings]]:
    """Read a joint and the settings of its models from a TOML file; the joint of the thesis is the default.

    The radius in section [ball] applies to sections without a radius. Raises InputError for an invalid file, an
    unknown section or key, or an unknown type of contact.
    """
    given = read_toml(path) if path else {}
    file = path.name if path else "design.toml"
    joint = read_joint(path) if path and "kind" in given else spherical_joint()
    if [r.axis for r in joint.rotations] != ["x", "y", "z"]:
        raise InputError(f"{file}: a design describes a ball in a socket; expected rotations about x, y and z")
    if "kind" not in given and (unknown := [key for key in given if key not in SECTIONS]):
        raise InputError(
            f"{file}: unknown key '{unknown[0]}', expected 'kind' or one of {choices(unknown[0], SECTIONS)}"
        )
    if flat := [key for key in SECTIONS if not isinstance(given.get(key, {}), dict)]:
        raise InputError(f"{file}: {flat[0]} = {given[flat[0]]!r}, expected a table [{flat[0]}]")
    sections = {name: dict(given.get(name, {})) for name in SECTIONS}
    if "ball" in given and "diameter" in given["ball"]:
        radius = laid_over("spherical_joint", {"ball": given["ball"]}, file)["ball"]["diameter"] / 2
        sections["film"].setdefault("ball_radius", f"{radius!r} m")
        own = {"major_radius": f"{radius!r} m", "minor_radius": f"{radius!r} m"}
        sections["contact"]["ball"] = own | sections["contact"].get("ball", {})
    settings = {name: laid_over(name, sections[name], f"{file} [{name}]") for name in SECTIONS if name != "demand"}
    demand = laid_over("design", {"demand": sections["demand"]}, file)["demand"]
    if demand["contact"] not in CONTACTS:
        raise InputError(f"{file}: demand.contact = '{demand['contact']}', expected one of {', '.join(CONTACTS)}")
    for key, value in demand.items():
        if key != "contact":
            positive(f"{file}: demand.{key}", value, "")
    return joint, settings | {"demand": demand}


def joint_design(path: Path | None = None, seed: int = 0) -> JointDesign:
    """Compute every limit of the joint in a TOML file, by default the thesis' joint. seed: seed of the error budget."""
    joint, s = read_design(path)
    demand = s["demand"]
    bare = demand["contact"] in ("point", "rolling")
    parts = [LoopPart(**part) for part in s["thermal"]["part"]]
    growth = abs(float(loop_growth(parts, s["thermal"]["temperature_change"])))
    limits = [*(_supports(s) if bare else _surface(s))]
    limits.append(_length("thermal", "growth of the loop", growth, s["thermal"]["tolerance"]))
    if demand["contact"] == "fluid":
        limits += _film(s)
    limits.append(_workspace(joint, demand))
    stiffness = _stiffness(s)
    limits.append(
        Limit("stiffness", "stiffness that is asked for", 1e-6 * demand["stiffness"], 1e-6 * stiffness, "N/um")
    )
    deflection = demand["load_change"] / stiffness
    limits.append(_length("stiffness", "deflection by the load's change", deflection, demand["deflection"]))
    error = sum(_budget(joint, s["budget"], kind, seed) ** 2 for kind in KINDS) ** 0.5
    limits.append(_length("budget", "geometric error, mean + 3 SD", error, demand["accuracy"]))
    total = float(np.sqrt(error**2 + growth**2 + deflection**2))
    limits.append(_length("accuracy", "budget, growth and deflection together", total, demand["accuracy"]))
    return JointDesign(joint, s, tuple(limits))


def _length(topic: str, quantity: str, used: float, there: float) -> Limit:
    """Return the limit of a length, in um, from the required (`used`) and available (`there`) length, m."""
    return Limit(topic, quantity, 1e6 * used, 1e6 * there, "um")


def _supports(s: dict[str, Settings]) -> Iterator[Limit]:
    """Yield the load limits of a ball on three supports: the pull [N] at which the first support unloads, and the
    pressure [GPa] under the most loaded support."""
    pull, preload, angle = s["demand"]["pull"], _preload(s), s["preload"]["contact_angle"]
    tilt, turn = np.radians(np.linspace(0, 90, 91))[:, None], np.radians(np.arange(0, 360, 3.0))
    least = float(three_contact_limit(preload, tilt, turn, angle).min())
    yield Limit("preload", "pull before a support unloads", pull, least, "N")
    towards, away = (contact_forces(p, pull, tilt, turn, contact_directions(angle)) for p in (preload, preload + pull))
    most = float(max(towards.max(), away.max()))
    contact = s["contact"]
    ball, support = Body(**contact["ball"]), Body(**contact["support"])
    onset = float(first_yield_pressure(contact["yield_stress"], min(ball.poisson, support.poisson)))
    peak = float(hertz(most, ball, support, contact["plane_angle"]).pressure)
    yield Limit("contact", "Hertz pressure against first yield", 1e-9 * peak, 1e-9 * onset, "GPa")


def _surface(s: dict[str, Settings]) -> Iterator[Limit]:
    """Yield the load limits of a socket without cut-outs: the pull [N] at which the ball leaves the socket, and the
    pressure [MPa] on the layer of cast (replicated) epoxy in the socket."""
    pull, preload, own = s["demand"]["pull"], _preload(s), s["preload"]
    least = float(socket_fixed_limit(preload, np.radians(np.linspace(0, 90, 181)), own["reaction_angle"]).min())
    yield Limit("preload", "pull before the ball leaves the socket", pull, least, "N")
    area = float(projected_area(s["film"]["ball_radius"], own["socket_angle"]))
    yield Limit(
        "contact", "pressure on the layer", 1e-6 * (preload + pull) / area, 1e-6 * s["demand"]["layer_strength"], "MPa"
    )


def _film(s: dict[str, Settings]) -> Iterator[Limit]:
    """Yield the limits of the air film: inlet pressure for the required lift, pneumatic hammer, thermal change of the
    gap."""
    demand, geometry = s["demand"], film_geometry(s["film"])
    guide = design_film(geometry, _preload(s), orifice_law(s["film"]["orifice"]), demand["lift"])
    inlet, supply = float(guide.inlet_pressure) / ATMOSPHERE, demand["supply"] / ATMOSPHERE
    yield Limit("film", "inlet pressure for the lift", inlet, supply, "atm")
    moved, mass, magnets = moving_film(s)
    least = moved.least_damped(mass, magnets, geometry.orifices * s["film"]["orifice"]["pocket"])
    left = decay_per_cycle(least)
    yield Limit("hammer", "share of a vibration that is left a cycle later", left, 1.0, "")
    change = float(gap_growth(**s["thermal"]["gap"], temperature_change=s["thermal"]["temperature_change"]))
    yield _length("film", "gap that growth takes or adds", abs(change), float(edge_gap(geometry, demand["lift"])))


def moving_film(s: dict[str, Settings]) -> tuple[FedFilm, float, float]:
    """Return the air film of a moving joint, the mass on the film [kg] and the stiffness of the magnets [N/m]."""
    film, preload = s["film"], _preload(s)
    moved = fed_film(film_geometry(film), preload, orifice_law(film["orifice"]), s["demand"]["lift"])
    mass = ball_mass(film["ball_radius"], s["dynamics"]["ball_density"]) + s["dynamics"]["added_mass"]
    return moved, mass, magnet_stiffness(preload, s["stiffness"]["stand_off"])


def _workspace(joint: PassiveJoint, demand: Settings) -> Limit:
    """Return the limit of the tilt, deg; available is the smaller range of the two rotations that tilt the shaft."""
    there = min(r.upper - r.lower for r in joint.rotations if r.axis != "z")
    asked = float(np.degrees(demand["workspace"]))
    return Limit("workspace", "tilt that is asked for", asked, float(np.degrees(there)), "deg")


def _stiffness(s: dict[str, Settings]) -> float:
    """Return a joint's axial stiffness at rest, N/m: of film and magnets, epoxy layer, or three Hertz contacts."""
    demand, preload = s["demand"], _preload(s)
    if demand["contact"] == "fluid":
        film = spherical_film(film_geometry(s["film"]), preload, orifice_law(s["film"]["orifice"]), demand["lift"])
        return float(film.stiffness_constant_inlet) + magnet_stiffness(preload, s["stiffness"]["stand_off"])
    if demand["contact"] == "sliding":
        return float(layer_stiffness(**s["stiffness"]["replica"]))
    contact, cosine = s["contact"], float(np.cos(s["preload"]["contact_angle"]))
    each = preload / (3 * cosine)
    return 3 * cosine**2 * float(hertz(each, Body(**contact["ball"]), Body(**contact["support"])).stiffness)


def _preload(s: dict[str, Settings]) -> float:
    rings = "contact_ring" if s["demand"]["contact"] in ("point", "rolling") else "ring"
    return total_preload([MagnetRing(**ring) for ring in s["preload"][rings]])


def _budget(joint: PassiveJoint, settings: Settings, kind: str, seed: int) -> float:
    """Return mean + 3 standard deviations of the systematic or stochastic error, m; 0 without sources."""
    sources = sources_of(settings)
    if not any(source.kind == kind for source in sources):
        return 0.0
    own = tuple(replace(r, name=name) for r, name in zip(joint.rotations, JOINTS, strict=True))
    rng = np.random.default_rng(seed)
    return error_budget(replace(joint, rotations=own), sources, kind, rng, BUDGET_POSES, BUDGET_DRAWS).worst_case
