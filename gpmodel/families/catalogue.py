"""The catalogue of known physical effects. Each row of the catalogue is a family, such as `joint_compliance`.

Each family of the catalogue cites a publication of its physics, or a recorded discovery.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from itertools import islice

from gpmodel.errors import InputError, choices
from gpmodel.families import angle as families_angle
from gpmodel.families import curves as families_curves
from gpmodel.families import frequency_grid
from gpmodel.families import instrument as families_instrument
from gpmodel.families import load as families_load
from gpmodel.families import session as families_session
from gpmodel.families.candidate import Candidate, one
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.states import States

PROVIDERS = "gpmodel.families"

Builder = Callable[[Mechanism, States], Iterable[Candidate | Effect]]


@dataclass(frozen=True)
class Family:
    """A named physical effect in the catalogue.

    name: one word, as written on a command line.
    explanation: physical mechanism of the effect.
    source: publication that describes the effect.
    build: function that yields the candidate effects for a mechanism and the columns of a table.
    grids: function that yields harmonics of the effect at any frequency of a range, for the search.
    offered: function that yields the candidates for a search, None if `build` yields them.
    generic: whether the family describes the form of an error without its cause; only the search uses a generic family.
    clamped: whether predictions hold the effect constant well beyond the fitted ranges of its inputs.
    refit_constants: whether the last fit refines constants in the basis functions, which were selected from a grid.
    yields: whether the effect is a compliance of a part without a drive, so that its coefficient is positive.
    wanders: whether the effect is a random motion during the session, which no formula predicts after the session.
    """

    name: str
    explanation: str
    source: str
    build: Builder
    grids: Callable[[Mechanism, States], Iterable[FrequencyGrid]] = lambda *_: ()
    offered: Builder | None = None
    generic: bool = False
    clamped: bool = False
    refit_constants: bool = False
    yields: bool = False
    wanders: bool = False

    def __post_init__(self) -> None:
        if not callable(self.build):
            raise InputError(f"family {self.name!r}: expected a function (mechanism, states) that yields effects")


def installed() -> tuple[Family, ...]:
    """Return the families of all installed plug-in packages: entry points of the group `gpmodel.families`.

    An entry point is one Family or a list of families. A plug-in that cannot be loaded is skipped with a warning.
    """
    found: list[Family] = []
    for provider in sorted(entry_points(group=PROVIDERS), key=lambda e: e.name):
        try:
            given = provider.load()
            families = (given,) if isinstance(given, Family) else tuple(given)
        except (ImportError, AttributeError, TypeError) as error:
            warnings.warn(f"families of '{provider.name}' cannot be loaded: {error}", stacklevel=2)
            continue
        found += [f for f in families if isinstance(f, Family)]
    return tuple(found)


Offer = Family | Candidate | Effect

PLAIN_COST = 4.0
"""Default penalty of an effect in the selection, nats: that of the simplest families. exp(4) = 55 is about the number
of sites of a six-joint arm."""


def distinct(offers: Iterable[object]) -> tuple[Offer, ...]:
    """Return families, candidates and effects as a tuple; raise InputError for any other object, or equal names."""
    kept: dict[str, Offer] = {}
    for offer in offers:
        if not isinstance(offer, Family | Candidate | Effect):
            raise InputError(
                f"{offer!r} is of type {type(offer).__name__}; expected a Family or an Effect", "candidates"
            )
        if offer.name in kept:
            raise InputError(f"'{offer.name}' is offered twice; expected each name once", "candidates")
        kept[offer.name] = offer
    return tuple(kept.values())


def instances(offer: Offer, mechanism: Mechanism, states: States, *, search: bool = False) -> Iterator[Candidate]:
    """Yield the candidates of a family, candidate or effect on a mechanism, with the explanation of the family.

    search: whether to yield the candidates that the family reserves for a search, if any.
    """
    match offer:
        case Candidate():
            yield offer
        case Effect():
            yield Candidate(offer.name, (offer,), offer.family or offer.name, PLAIN_COST)
        case Family(build=build, offered=offered):
            for instance in (offered if search and offered else build)(mechanism, states):
                yield _of_family(instance, offer)


def _of_family(instance: Candidate | Effect, family: Family) -> Candidate:
    match instance:
        case Candidate():
            found = instance
        case Effect():
            found = one(instance.name, replace(instance, family=family.name), PLAIN_COST)
        case _:
            raise InputError(
                f"family '{family.name}' yields a {type(instance).__name__}; expected candidates or effects"
            )
    if found.family != family.name:
        raise InputError(f"family '{family.name}': candidate '{found.name}' belongs to family '{found.family}'")
    return replace(found, explanation=f"{family.explanation} ({family.source})")


# ruff: noqa: E501
_OWN: tuple[Family, ...] = (
    Family("base_compliance", "the foundation tilts under the gravity moment of the arm", "Robertson et al. 2002", families_load.base_compliance, yields=True),
    Family("joint_compliance", "gearbox and structure twist about the joint under its gravity torque", "Robertson et al. 2002 (as joint bending); Dumas 2011", families_load.joint_compliance, yields=True),
    Family("wrong_masses", "the joint yields to weights that are not those of the description", "Khalil and Dombre 2002, ch. 9", families_load.wrong_masses),
    Family("unknown_masses", "the joint yields to unknown weights: torques of unit moments of mass", "Khalil and Dombre 2002, ch. 9", families_load.unknown_masses),
    Family("base_unknown_masses", "the foundation tilts under unknown weights", "Khalil and Dombre 2002, ch. 9; Robertson et al. 2002", families_load.base_unknown_masses),
    Family("payload_deflection", "the controller allows for the arm's own weight, not for what it carries", "Dumas 2011", families_load.payload_deflection, yields=True),
    Family("joint_bending", "the bearing tilts across the joint's axis, or the carriage on its guideway, under the gravity moment", "Klimchik 2014", families_load.joint_bending, yields=True),
    Family("eccentricity", "encoder disc or gear off its centre: one cycle a turn", "Slocum 1992, ch. 6", families_angle.eccentricity),
    Family("gear_harmonic", "two cycles a turn: oval gear or flexspline", "Tuttle 1992", families_angle.gear_harmonic),
    Family("transmission_ripple", "a tooth- or wave-generator-passing error of the transmission", "Tuttle 1992", frequency_grid.transmission_ripple, frequency_grid.ripple_grids, refit_constants=True),
    Family("mesh_compliance", "the teeth in mesh yield to the torque, some more and some less: compliance that changes from tooth to tooth", "Kahraman and Singh 1991", frequency_grid.mesh_compliance, frequency_grid.mesh_grids, refit_constants=True),
    Family("joint_curve", "encoder and transmission together: a smooth error curve of the joint's own angle", "recorded discovery: the measured UR10 and UR5", families_angle.joint_curve, offered=families_curves.curves, clamped=True),
    Family("backlash_load", "the play of the gear falls to the side its gravity torque points to", "Gong 2000", families_load.backlash_load),
    Family("play_last_move", "the play of the gear is on the side the joint last moved from", "ISO 230-2; Gong 2000", families_session.play_last_move),
    Family("friction_windup", "friction winds the transmission up against its last move, the more the higher its load", "Armstrong-Hélouvry 1991", families_session.friction_windup),
    Family("hysteresis", "the transmission yields along a loop: many small plays in series (Prandtl-Ishlinskii)", "Visintin 1994, ch. III", families_session.hysteresis),
    Family("backlash_approach", "the play of the gear depends on the direction of approach", "ISO 230-2", families_angle.backlash_approach),
    Family("gear_ratio", "the transmission ratio differs from the nominal one", "Mooring 1991", families_angle.gear_ratio),
    Family("wrist_coupling", "one axis drags another through its gears or its spindle", "Mooring 1991", families_angle.wrist_coupling),
    Family("parallel_bar_closure", "the parallel bar is no exact parallelogram", "Schröer 1997", families_angle.parallel_bar),
    Family("balancing_spring", "the balancing spring leaves a torque over the angle of its axis", "Schröer 1997", families_load.balancing_spring),
    Family("hardening_stiffness", "stiffness grows with load: strain-wave gear", "Harmonic Drive catalogue, torsional stiffness K1-K3", families_load.hardening, offered=families_load.compliance_with_hardening),
    Family("thermal_growth", "links grow with temperature", "Slocum 1992, ch. 2", families_session.thermal_growth),
    Family("lagged_growth", "thick parts follow the room's temperature late, in the first order", "Slocum 1992, ch. 2; ISO 230-3", families_session.lagged_growth),
    Family("thermal_zero", "a joint's zero drifts with temperature", "Gong 2000", families_session.thermal_zero),
    Family("instrument_range", "the instrument's distances are off by a scale or an offset", "ISO 10360-10", families_instrument.instrument_range, offered=families_instrument.or_beyond(families_instrument.instrument_range)),
    Family("instrument_azimuth", "the encoder of the instrument's standing axis runs out", "Muralikrishnan et al. 2009", families_instrument.instrument_azimuth, offered=families_instrument.or_beyond(families_instrument.instrument_azimuth)),
    Family("instrument_elevation", "the encoder of the instrument's elevation has an index error or runs out", "Muralikrishnan et al. 2009", families_instrument.instrument_elevation, offered=families_instrument.or_beyond(families_instrument.instrument_elevation)),
    Family("instrument_axes", "the instrument's axes and its beam are not square to each other", "Muralikrishnan et al. 2009", families_instrument.instrument_axes, offered=families_instrument.or_beyond(families_instrument.instrument_axes)),
    Family("instrument_field", "a smooth error of the instrument over its volume: refraction, a camera's lens", "ISO 10360-10; VDI/VDE 2634", families_instrument.instrument_field, offered=families_instrument.or_beyond(families_instrument.instrument_field)),
    Family("instrument_walk", "the instrument wanders at random during the session", "ISO 10360-10", families_instrument.instrument_walk, offered=families_instrument.instrument_walks),
    Family("drift", "instrument or base creeps during the session", "ISO 230-3", families_session.drift, clamped=True),
    Family("set_up_step", "the instrument or the base was moved between two rows", "ISO 10360-10", families_session.setup_step),
    Family("tool_slip", "the reflector or the tool shifted between two rows", "ISO 10360-10", families_session.tool_slip),
    Family("zero_slip", "the zero of a joint shifted between two rows", "Mooring, Roth and Driels 1991, ch. 1", families_session.zero_slip),
    Family("warm_up", "an exponential approach to the warm state", "ISO 230-3", families_session.warm_up),
    Family("settling", "after an event of the session a part approaches its new state exponentially", "ISO 230-3", families_session.settling),
    Family("axis_wobble", "the axis tilts as it turns", "ISO 230-7", families_angle.axis_wobble),
    Family("axis_motion", "the axis wobbles or runs out along a smooth curve of its angle", "ISO 230-7", families_angle.axis_motion),
    Family("linear_axis", "straightness, pitch, yaw, roll and positioning of a linear axis along its travel", "ISO 230-1", families_angle.linear_curves),
    Family("cyclic_error", "a screw, rack or scale errs once every lead or pitch", "ISO 230-2; Slocum 1992, ch. 10", families_angle.cyclic, families_angle.cyclic_grids, refit_constants=True),
    Family("axis_run_out", "the axis shifts as it turns", "ISO 230-7", families_angle.run_out),
    Family("ball_lobes", "an out-of-round ball lifts in its socket as it turns", "ISO 12181-1; Robertson 2003, 3.3.2", families_angle.ball_lobes),
    Family("support_sag", "the part sinks into its support along the gravity direction of the pose", "Robertson 2003, 4.2 (stiffness of the contact)", families_load.support_sag),
    Family("preload", "a ball joint yields once what pulls at it comes near the force that holds it", "Robertson 2003, 3.1 (preload by magnets)", families_load.preload),
    Family("following", "the place follows an angle or a column of the table; which part does is not known", "recorded discovery: the measured UR10 and UR5", families_curves.following, generic=True),
    Family("set_up_wander", "the set-up wanders slowly along the rows", "ISO 230-3", families_curves.wander, generic=True, wanders=True),
    Family("session_curve", "a joint drifts along the rows", "ISO 230-3", families_curves.session, generic=True),
    Family("structure_compliance", "a link, bearing or the foundation yields along one axis under the load there", "Klimchik 2014", families_curves.compliances, generic=True),
    Family("cross_compliance", "a joint yields under the torque of another: stiffness that is not where it is drawn", "Klimchik 2014", families_curves.all_torques, generic=True),
    Family("load_curve", "the joint yields along a curve of its torque: hardening, saturation, a dead band", "Ruderman et al. 2009; Harmonic Drive catalogue, torsional stiffness K1-K3", families_curves.load_curves, generic=True),
)  # fmt: skip

catalogue: tuple[Family, ...] = (*_OWN, *installed())
"""The catalogue: families of effects in this package, then those of installed plug-ins."""


def candidates(mechanism: Mechanism, states: States, offers: Iterable[Offer] = catalogue) -> tuple[Candidate, ...]:
    """Return the candidates of all families that name a cause, for a mechanism and the columns of its table.

    offers: families, candidates and single effects. Raises InputError for another type, or if two offers have one name.
    """
    named = (offer for offer in distinct(offers) if not (isinstance(offer, Family) and offer.generic))
    found = tuple(c for offer in named for c in instances(offer, mechanism, states))
    first: dict[str, Candidate] = {}
    for c in found:
        if [e.terms for e in first.setdefault(c.name, c).effects] != [e.terms for e in c.effects]:
            families = " and ".join(dict.fromkeys((first[c.name].family, c.family)))
            raise InputError(f"family {families}: two effects are called '{c.name}'; expected different names")
    return found


def names() -> tuple[str, ...]:
    """Return the names of the families that name a cause, generic families excluded."""
    return tuple(f.name for f in catalogue if not f.generic)


def family(name: str) -> Family | None:
    """Return the family with a given name, or None if no family has the name."""
    return next((f for f in catalogue if f.name == name), None)


def explained(name: str) -> str:
    """Return the physical explanation and source of the family named `name`, or an empty text."""
    found = family(name)
    return f"{found.explanation} ({found.source})" if found else ""


def build(name: str, mechanism: Mechanism, states: States) -> tuple[Effect, ...]:
    """Return the effects with a name as on a command line: `family`, `family JOINT`, or the full name of a candidate or
    effect.

    Raises InputError for an unknown name, for a family without an effect on this mechanism and table, or if words
    without a joint fit effects at several sites. The family with which the name begins is searched first.
    """
    first, *words = name.split() or [""]
    pool = of_family(first, mechanism, states)
    found = _of_full_name(name, pool)
    joints = {word: j.name for j in mechanism.joints for word in (j.name.removeprefix("_"), j.name)}
    joints = {f"J{i}": j.name for i, j in enumerate(mechanism.joints, 1)} | joints
    wanted = [c for c in pool if all(joints.get(w, w) in _words(c.name) for w in words)]
    if not found and words and len({c.effects[0].slots for c in wanted}) > 1 and not any(map(joints.get, words)):
        few = choices(name, (c.name for c in wanted))
        raise InputError(f"effect '{name}' names no joint and fits {len(wanted)} effects; expected one: {few}")
    if found or wanted:
        return found or wanted[0].effects
    pool = candidates(mechanism, states)
    if found := _of_full_name(name, pool) or _with_constants(name, mechanism, states, pool):
        return found
    if first not in names():
        raise InputError(f"effect '{name}' is unknown; available: {choices(first, names())}")
    named = [c.name for c in pool if c.family == first]
    instances = choices(name, named) if named else _none(states)
    raise InputError(
        f"effect '{name}' does not exist for {mechanism.name} and the table; effects of {first}: {instances}"
    )


def _none(states: States) -> str:
    """State that a family has no effect, and the missing loads if the mechanism and the table have no masses."""
    loaded = any(states[name].any() for name in states.loads if name in states.columns)
    return "none" if loaded else "none; loads are unknown without masses of the links or a payload"


def of_family(name: str, mechanism: Mechanism, states: States) -> tuple[Candidate, ...]:
    """Return all candidates of the family with a given name; none for an unknown name or a generic family."""
    return candidates(mechanism, states, [f for f in catalogue if f.name == name])


def _of_full_name(name: str, pool: Sequence[Candidate]) -> tuple[Effect, ...]:
    exact = next((c.effects for c in pool if c.name == name), ())
    return exact or tuple(islice((e for c in pool for e in c.effects if e.name == name), 1))


def _with_constants(name: str, mechanism: Mechanism, states: States, pool: Sequence[Candidate]) -> tuple[Effect, ...]:
    """Return the effects of a printed name, whose constants may differ from those of the catalogue's candidates."""
    rates = (grid for f in catalogue for grid in f.grids(mechanism, states))
    known = [*(c.inner for c in pool if c.inner), *(i for g in rates if (i := g.at(float(g.rates[0])).inner))]
    for inner in {own.name: own for own in known}.values():
        if (values := inner.read(name)) is not None:
            return inner.at(values).effects
    return ()


def _words(text: str) -> list[str]:
    """Split the name of a candidate effect into words."""
    return text.replace(",", " ").replace("(", " ").replace(")", " ").split()
