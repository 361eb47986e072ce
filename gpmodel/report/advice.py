"""What to measure to be sure of a finding, by the kind of column it reads."""

from collections.abc import Iterator, Set

from gpmodel.model.memory import constant_of, read_by
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord
from gpmodel.table.units import is_time, known_unit

LOW_SHARE = 0.3
"""Below this unique share σ is more than three times what it would be without the other unknowns (1 / share)."""
WELL_KNOWN = 10.0
"""Standard deviations from zero: its value is then known to a tenth."""

MEASURES = {
    "clock": "measure the first poses once more at the end, and once after a night: an event of the session does not "
    "come back",
    "temperature": "measure the same dozen poses cold and warm, the temperature in its own column",
    "payload": "measure the same dozen poses with two payloads at least",
    "load": "measure the same dozen poses with and without payload: a load's part grows with it, an angle's does not",
    "approach": "approach the same dozen poses from either side of the joint, the direction in a column approach_J",
    "delay": "change it in one step, then measure the same poses again and again until they are still",
    "speed": "approach the same poses slowly and fast",
}
"""By the kind of a column: what would tell its effect from everything else."""


def kinds_of(name: str, unit: str, joints: Set[str]) -> tuple[str, ...]:
    """What a column is: clock, temperature, payload, load, approach, delay, speed; none for an angle or an unknown."""
    derived = constant_of(name)
    if derived is not None:
        what, source, _ = derived
        return ("delay" if what == "lag" else "approach", *kinds_of(source, unit, joints))
    if read_by(name) or name in {f"approach_{j}" for j in joints} or name.startswith("approach_"):
        return ("approach",)
    if name == "row" or is_time(unit):
        return ("clock",)
    if name in joints:
        return ()
    if name.startswith(("torque_", "moment_", "force_", "payload_torque_")):
        return ("load",)
    if name == "payload":
        return ("payload",)
    if unit in ("degC", "degF", "K"):
        return ("temperature",)
    return ("speed",) if _is_speed(unit) else ()


def _is_speed(unit: str) -> bool:
    amount, stroke, per = unit.partition("/")
    return bool(stroke) and known_unit(amount) and is_time(per)


def advice(report: Report, effect: EffectRecord, tellable: Set[str] | None) -> Iterator[str]:
    """Sentences; tellable: the rivals that further poses could tell from it, by name; None where nobody asked."""
    close = [r.name for r in effect.close_rivals()]
    told = [name for name in close if tellable is None or name in tellable]
    if told:
        yield f"take poses at which it and {told[0]} differ: `gpmodel poses --after` this result chooses them"
    elif close:
        yield (
            f"no poses of this mechanism tell it from {close[0]}: only another quantity does, such as a changed "
            "payload, a second point of the tool or the orientation"
        )
    elif effect.value and effect.stderr is not None and abs(effect.value) < WELL_KNOWN * effect.stderr:
        yield "take the poses that tell most of it: `gpmodel poses --after` this result with `--criterion effect`"
    units, joints = {r.input: r.unit for r in effect.ranges}, frozenset(report.mechanism.joints)
    found = {kind for name in effect.inputs for kind in kinds_of(name, units.get(name, "1"), joints)}
    yield from (said for kind, said in MEASURES.items() if kind in found)
    angles = [name for name in effect.inputs if name in joints]
    if angles:
        yield f"sweep {' and '.join(angles)} alone through the whole range, all other joints still, in both directions"
    if effect.unique_share is not None and effect.unique_share < LOW_SHARE:
        near = ", ".join(c.name for c in effect.correlated_with[:3]) or "the standard model"
        yield f"widen the range of the joints: on these poses it is hard to tell from {near}"
    if report.noise_floor_mm is None:
        yield "repeat some poses: without a noise floor nobody knows how much is left to find"
