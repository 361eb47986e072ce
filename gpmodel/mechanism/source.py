"""What a mechanism is loaded from: a name or file, its measured frame, and what it carries."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Joint, Mechanism, Weighed
from gpmodel.mechanism.quantities import checked_mass
from gpmodel.mechanism.registry import load_mechanism
from gpmodel.mechanism.workspace import links


@dataclass(frozen=True)
class MechanismChoice:
    """Name or file of a mechanism. frame: measured link. payload: kg or None; payload_com: (3,) m or None."""

    name: str
    frame: str | None = None
    payload: float | None = None
    payload_com: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.payload is not None:
            checked_mass(self.payload, "", "payload")

    def load(self) -> "LoadedMechanism":
        """The mechanism. Raises InputError when it is unknown or its file bad."""
        return LoadedMechanism(self, load_mechanism(self.name, frame=self.frame, payload_com=self.payload_com))


@dataclass(frozen=True, repr=False)
class LoadedMechanism:
    """A mechanism that knows what it was loaded from and what it carries: itself a Mechanism.

    choice: what to load again, which is how a saved model finds its mechanism. bare: what the provider built.
    """

    choice: MechanismChoice
    bare: Mechanism

    @property
    def name(self) -> str:
        return self.bare.name

    @property
    def joints(self) -> tuple[Joint, ...]:
        return self.bare.joints

    @property
    def slots(self) -> tuple[str, ...]:
        return self.bare.slots

    def transforms(self, q: Array) -> Array:
        """As Mechanism.transforms."""
        return self.bare.transforms(q)

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """As Mechanism.loads."""
        return self.bare.loads(q, payload)

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """As Weighed.unit_loads; none where the mechanism does not say."""
        return self.bare.unit_loads(q) if isinstance(self.bare, Weighed) else {}

    @property
    def levers(self) -> dict[str, Array]:
        """As workspace.links of what the provider built."""
        return links(self.bare)

    def reaching(self, point: Iterable[float]) -> "LoadedMechanism":
        """The same where a first fit found the tool `point` (3,), m, in the measured frame; it matters to a lever."""
        moved = getattr(self.bare, "reaching", None)
        return self if moved is None else replace(self, bare=moved(point))

    def carrying_at(self, point: Iterable[float]) -> "LoadedMechanism":
        """The same with the centre of mass of its payload at `point` (3,), m, in the measured frame."""
        return replace(self.choice, payload_com=tuple(float(v) for v in point)).load()

    def __repr__(self) -> str:
        carried = "" if self.choice.payload is None else f", payload {self.choice.payload:g} kg"
        return f"<mechanism {self.name}: joints {', '.join(j.name for j in self.joints)}{carried}>"


def choice_of(mechanism: Mechanism) -> MechanismChoice:
    """What `mechanism` can be loaded from again; its name alone where it was built in Python."""
    return mechanism.choice if isinstance(mechanism, LoadedMechanism) else MechanismChoice(mechanism.name)
