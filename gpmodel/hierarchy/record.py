"""fleet.json: mean, spread and machines of one type, with a bound on every value.

Values in fleet.json are in SI units, stated with each value; fields that end in `_mm` are in millimetres.
"""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from gpmodel.application.model_reader import (
    LARGEST_NUMBER,
    MOST_EFFECTS,
    MOST_TERMS,
    Deviation,
    FileName,
    Finite,
    Label,
    Name,
    Point,
    Sealed,
    TermPart,
    Unit,
    Word,
    read_sealed,
)
from gpmodel.errors import InputError
from gpmodel.files import to_json
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import same_machine, tip_at_trial
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, Term
from gpmodel.model.error_model import ErrorModel
from gpmodel.texts import SEAL, read_toml, seal

TABLES = (".csv", ".txt", ".xlsx")
HIDDEN = (".", "~$")
"""Prefixes of file names that are not tables. Excel writes a file `~$...` next to an open table."""
LONGEST_NAME = 60
"""Largest number of characters of the folder name of a machine."""
ABOUT = "fleet.toml"
EXPECTED = "mechanism = NAME and, below [serials], FILE = SERIAL"


@dataclass(frozen=True)
class Folder:
    """The tables of a folder by serial number of the machine, and the mechanism if fleet.toml states one."""

    tables: Mapping[str, Path]
    mechanism: str | None

    @property
    def said_mechanism(self) -> str:
        """Mechanism of all machines in the folder. Raises InputError if the folder states no mechanism."""
        if self.mechanism is None:
            raise InputError(f"is missing; expected a name or a file, here or in {ABOUT}", "mechanism")
        return self.mechanism


def folder_of_tables(folder: Path) -> Folder:
    """Return every table in a folder, by the serial that fleet.toml gives its file, else by the file name without
    suffix.

    fleet.toml: `mechanism`, a name or a file relative to the folder, and `[serials]`, both optional. Raises InputError
    if the folder or its tables are missing, if two tables have one serial, if a listed file is missing, or if
    fleet.toml cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with a table for each machine")
    files = _tables(folder)
    if not files:
        raise InputError(f"{folder}: has no tables ({', '.join(TABLES)}); expected one for each machine")
    mechanism, serials = _said(folder / ABOUT)
    if missing := sorted(set(serials) - {p.name for p in files}):
        raise InputError(f"{folder / ABOUT}: '{missing[0]}' is no table of the folder; expected one of its files")
    tables: dict[str, Path] = {}
    for path in files:
        serial = serials.get(path.name, path.stem)
        if serial in tables:
            raise InputError(
                f"{folder}: {tables[serial].name} and {path.name} are both of machine '{serial}'; "
                "expected one table per machine"
            )
        tables[serial] = path
    return Folder(tables, mechanism)


def folder_names(serials: Sequence[str]) -> tuple[str, ...]:
    """Return a folder name for each machine: its serial in valid characters, numbered if names are equal."""
    plain = [re.sub(r"[^\w-]+", "_", serial)[:LONGEST_NAME] for serial in serials]
    alike = {name for name, count in Counter(name.lower() for name in plain).items() if count > 1}
    return tuple(f"{n}-{k}" if n.lower() in alike else n for k, n in enumerate(plain, 1))


def files_of(folder: Path) -> tuple[Path, ...]:
    """Return every table in a folder, and its fleet.toml if there is one. Raises InputError if a table is no file."""
    return (*_tables(folder), *(path for path in [folder / ABOUT] if path.is_file()))


def _tables(folder: Path) -> list[Path]:
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in TABLES and not p.name.startswith(HIDDEN))
    if other := next((p for p in found if not p.is_file()), None):
        raise InputError(f"{other}: is no file; expected a measured table")
    return found


def _said(path: Path) -> tuple[str | None, dict[str, str]]:
    """Return the mechanism and the serial numbers from a fleet.toml; None and no serials without the file."""
    if not path.exists():
        return None, {}
    content = read_toml(path, EXPECTED)
    if unknown := sorted(set(content) - {"mechanism", "serials"}):
        raise InputError(f"{path}: '{unknown[0]}' is unknown; expected {EXPECTED}")
    mechanism, serials = content.get("mechanism"), content.get("serials", {})
    if not isinstance(mechanism, str | None) or not isinstance(serials, dict):
        raise InputError(f"{path}: mechanism or serials have the wrong type; expected {EXPECTED}")
    if not all(isinstance(s, str) and s for s in serials.values()):
        raise InputError(f"{path}: a serial is no text; expected {EXPECTED}")
    beside = path.parent / (mechanism or "")
    return str(beside) if mechanism and beside.is_file() else mechanism, serials


KIND, SCHEMA, NAME = "gpmodel fleet", 2, "fleet.json"
MACHINES = "machines"
"""Name of the folder next to fleet.json that has a folder for each machine."""
NOISE = "noise of one coordinate"
"""Name of the last parameter of a fleet, the noise. Values of the noise parameter are logarithms of metres."""
MOST_MACHINES = 10_000
"""Largest number of machines in a fleet. More machines hardly change the mean and spread of a type."""

PerMachine = Annotated[tuple[Finite, ...], msgspec.Meta(max_length=MOST_MACHINES)]


class MachinePart(msgspec.Struct, frozen=True):
    """One machine of the fleet in fleet.json.

    effects: names of the machine's effects in addition to the effects of the type.
    folder: folder of the machine's page and model, below the folder of fleet.json.
    sigma_mm: standard deviation σ of one coordinate, mm.
    standard_mm, own_mm, fleet_mm: RMS 3-D errors on held-out poses of the standard model, of the fit to the machine's
    poses alone and of the fit with the prior of the type; null if no pose is held out.
    loads: loads in words that were fitted in the place of the declared loads; empty for the declared loads.
    """

    serial: Label
    folder: FileName
    effects: Annotated[tuple[Label, ...], msgspec.Meta(max_length=MOST_EFFECTS)]
    file: Name
    sha256: Name
    poses: int
    train: int
    sigma_mm: Deviation
    standard_mm: Deviation | None
    own_mm: Deviation | None
    fleet_mm: Deviation | None
    loads: Name = ""


class SharedPart(msgspec.Struct, frozen=True):
    """Record of a parameter over the machines of a type.

    mean, stderr, spread: mean over the type, its standard error, spread between machines. low, high: 95 % interval of
    the spread.
    values, stderrs: value and standard error of each machine alone.
    shrunken: value of each machine with the prior of the type; empty for geometry, whose prior has further constants.
    z, chances: deviation of each machine from the others, and its chance for any machine of a fleet without outliers.
    outliers: indices of outlying machines, which do not count for the mean and spread.
    """

    name: Label
    unit: Unit
    constant: bool
    mean: Finite
    stderr: Deviation
    spread: Deviation
    low: Deviation
    high: Deviation
    values: PerMachine
    stderrs: PerMachine
    shrunken: PerMachine
    shrunken_stderrs: PerMachine
    z: PerMachine
    chances: PerMachine
    outliers: tuple[Annotated[int, msgspec.Meta(ge=0)], ...]

    @property
    def prior(self) -> float:
        """Prior standard deviation of the parameter for a further machine of the type."""
        return math.hypot(self.spread, self.stderr)


class PriorPart(msgspec.Struct, frozen=True):
    """Prior of an effect for a further machine of a type: mean and standard deviation."""

    name: Label
    family: Name
    unit: Unit
    terms: Annotated[tuple[TermPart, ...], msgspec.Meta(min_length=1, max_length=MOST_TERMS)]
    mean: Finite
    deviation: Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST_NUMBER)]

    @property
    def effect(self) -> Effect:
        """The effect with its prior for a further machine of the type."""
        terms = tuple(Term(t.slot, t.axis, Expression(t.basis), t.weight) for t in self.terms)
        return Effect(self.name, terms, self.unit, self.family, self.deviation, self.mean)


class BlockPart(msgspec.Struct, frozen=True):
    """Effects with priors of their own, such as the harmonics of a curve, tested together.

    effects: effects of the block with their own priors.
    spread, low, high: standard deviation between machines, as a share of the effects' priors, and its 95 % interval.
    z: RMS distance of each machine from the others in the directions that its poses determine; signed for one effect.
    chances, outliers: p-value of the distance of each machine, and indices of outlying machines.
    """

    name: Label
    effects: Annotated[tuple[PriorPart, ...], msgspec.Meta(min_length=1, max_length=MOST_EFFECTS)]
    spread: Deviation
    low: Deviation
    high: Deviation
    z: PerMachine
    chances: PerMachine
    outliers: tuple[Annotated[int, msgspec.Meta(ge=0)], ...]


Part = SharedPart | BlockPart


class FleetPart(msgspec.Struct, frozen=True):
    """The content of fleet.json without its checksum.

    columns: names of the joints in the tables, if all tables agree.
    chosen: text on the origin of the effects.
    left_out: effects that the poses of some machine do not determine.
    parameters: geometry, effects without priors of their own, and the noise.
    prior: effects of a further machine and their priors, with complete geometry.
    """

    kind: str
    schema: int
    version: Name
    command: str
    seed: int
    mechanism: Label
    tip_at_probe_m: Point
    joints: Annotated[tuple[Word, ...], msgspec.Meta(min_length=1, max_length=200)]
    columns: Annotated[tuple[Word, ...], msgspec.Meta(min_length=1, max_length=200)]
    chosen: str
    left_out: Annotated[tuple[Label, ...], msgspec.Meta(max_length=MOST_EFFECTS)]
    machines: Annotated[tuple[MachinePart, ...], msgspec.Meta(min_length=2, max_length=MOST_MACHINES)]
    parameters: Annotated[tuple[SharedPart, ...], msgspec.Meta(min_length=1, max_length=MOST_EFFECTS)]
    blocks: Annotated[tuple[BlockPart, ...], msgspec.Meta(max_length=MOST_EFFECTS)]
    prior: Annotated[tuple[PriorPart, ...], msgspec.Meta(min_length=1, max_length=MOST_EFFECTS)]

    def __post_init__(self) -> None:
        for part in self.parts:
            lengths = {len(part.z), len(part.chances)}
            if isinstance(part, SharedPart):
                lengths |= {len(part.values), len(part.stderrs)}
                lengths |= {len(values) for values in (part.shrunken, part.shrunken_stderrs) if values}
            if lengths != {len(self.machines)}:
                raise ValueError(f"expected {len(self.machines)} values, one a machine - at `$.{part.name}`")
            if any(k >= len(self.machines) for k in part.outliers):
                raise ValueError(f"expected numbers of machines - at `$.{part.name}.outliers`")
        if self.parameters[-1].name != NOISE:
            raise ValueError(f"expected '{NOISE}' last - at `$.parameters`")
        if unknown := {e.name for block in self.blocks for e in block.effects} - {part.name for part in self.prior}:
            raise ValueError(f"expected effects of the prior, not '{min(unknown)}' - at `$.blocks`")

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parameters, then the blocks: all quantities in which a machine is compared with the others."""
        return (*self.parameters, *self.blocks)

    @property
    def effects(self) -> tuple[SharedPart, ...]:
        """Every parameter except the noise: the effects without priors of their own."""
        return self.parameters[:-1]

    @property
    def noise(self) -> float:
        """Standard deviation σ of one coordinate, m, of a machine of the type."""
        return math.exp(self.parameters[-1].mean)

    def outliers(self) -> list[tuple[int, Part]]:
        """Return pairs of an outlying machine and its deviating parameter or block, the least probable first."""
        found = [(k, part) for part in self.parts for k in part.outliers]
        return sorted(found, key=lambda one: one[1].chances[one[0]])

    def worst_first(self) -> list[int]:
        """Return the machines in order of their smallest p-value in any parameter or block, then of the largest |z|."""
        return sorted(range(len(self.machines)), key=lambda k: (self.worst(k).chances[k], -abs(self.worst(k).z[k])))

    def worst(self, machine: int) -> Part:
        """Return the parameter or block in which a machine differs most from the others."""
        return min(self.parts, key=lambda part: (part.chances[machine], -abs(part.z[machine])))


FILE = Sealed(KIND, (SCHEMA,), FleetPart, "fleet", f"the {NAME} of gpmodel fleet")


def prior_model(fleet: FleetPart, mechanism: Mechanism) -> ErrorModel:
    """Return the prior model of a further machine of the type: effects with mean and prior, and the noise.

    Raises InputError if the machines of the fleet have other joints or another nominal geometry.
    """
    joints = tuple(joint.name for joint in mechanism.joints)
    if fleet.joints != joints or not same_machine(fleet.tip_at_probe_m, tip_at_trial(mechanism)):
        raise InputError(
            f"is of machines of another type, {fleet.mechanism} with joints {', '.join(fleet.joints)}; expected "
            f"{mechanism.name} with {', '.join(joints)}", "fleet",
        )  # fmt: skip
    return ErrorModel(mechanism, tuple(part.effect for part in fleet.prior), noise=fleet.noise)


def check_serial(serial: object) -> None:
    """Raise InputError for a serial number that fleet.json cannot hold."""
    try:
        msgspec.convert(serial, Label)
    except msgspec.ValidationError:
        raise InputError(
            f"machine {serial!a}: expected 1 to 1000 characters without quotes, backslashes, line ends"
        ) from None


def prior_parts(effects: tuple[Effect, ...]) -> tuple[PriorPart, ...]:
    """Return effects and their priors as records for fleet.json."""
    return tuple(
        PriorPart(
            e.name, e.family, e.unit, tuple(TermPart(t.slot, t.axis, str(t.basis), t.weight) for t in e.terms),
            e.mean, e.prior,
        )
        for e in effects
    )  # fmt: skip


def fleet_text(fleet: FleetPart) -> str:
    """Return the text of fleet.json, including its checksum."""
    content = msgspec.to_builtins(fleet)
    return to_json(content | {SEAL: seal(content)})


def fleet_file(path: Path) -> Path:
    """Return the path of the fleet.json in a folder, or the path itself for a file."""
    return path / NAME if path.is_dir() else path


def read_fleet(path: Path) -> FleetPart:
    """Read the content of a fleet.json. Raises InputError for a missing, damaged or changed file."""
    return read_sealed(path, FILE)[0]
