"""What a mechanism is loaded from: a name or file, its measured frame, and what it carries."""

from dataclasses import dataclass

from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.registry import load_mechanism


@dataclass(frozen=True)
class MechanismChoice:
    """Name or file of a mechanism. frame: measured link. payload: kg or None; payload_com: (3,) m or None."""

    name: str
    frame: str | None = None
    payload: float | None = None
    payload_com: tuple[float, ...] | None = None

    def load(self) -> Mechanism:
        """The mechanism. Raises InputError when it is unknown or its file bad."""
        return load_mechanism(self.name, frame=self.frame, payload_com=self.payload_com)
