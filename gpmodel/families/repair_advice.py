"""Advice for the repair of each error family of the catalogue, from repair_advice.toml."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from gpmodel.texts import read_toml

FILE = Path(__file__).with_name("repair_advice.toml")


@dataclass(frozen=True)
class RepairAdvice:
    """Four sentences of advice for whoever repairs the machine.

    sign: symptom of the effect that is visible on the machine.
    check: how to check the machine by hand.
    clause: clause of ISO 9283, ISO 230 or another standard whose test result changes.
    compensation: what corrected joint values can and cannot do.
    """

    sign: str
    check: str
    clause: str
    compensation: str

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        """Headings with their sentences of repair advice."""
        headings = ("sign", "check by hand", "standard", "compensation")
        return tuple(zip(headings, (self.sign, self.check, self.clause, self.compensation), strict=True))


@cache
def repair_advice() -> Mapping[str, RepairAdvice]:
    """Return the repair advice for each error family, by the name of the family."""
    rows = read_toml(FILE, "the advice of the catalogue")["advice"]
    return {name: RepairAdvice(**row) for row in rows for name in row.pop("families")}
