"""What is odd and was not added, in words: never a finding, always with what would decide it."""

from collections.abc import Sequence

from gpmodel import wording
from gpmodel.report.schema_search import SuspectRecord

LEAD = "Not findings, and in no model: something speaks for each of them, too little to add it. Further poses decide."


def in_the_verdict(suspects: Sequence[SuspectRecord]) -> str:
    """That something odd is left, and where; empty where nothing is."""
    if not suspects:
        return ""
    rows = next((s.rows for s in suspects if s.rows), ())
    odd = f": {len(rows)} poses have large errors in common" if rows else ""
    count = "One suspect is" if len(suspects) == 1 else f"{len(suspects)} suspects are"
    return f"{count} left for further poses to decide{odd}."


def would_explain(suspect: SuspectRecord) -> str:
    """How far off which poses are, what they share, and what is left of that with the effect."""
    change = wording.change(suspect.before_mm, suspect.after_mm)
    saved = "" if suspect.nats is None else f", {suspect.nats:.0f} nats, chance {wording.chance(suspect.p_value)}"
    if not suspect.rows:
        return f"would bring the cross-validated error of all poses {change}{saved}"
    rows = ", ".join(map(str, suspect.rows))
    shared = f", which share {suspect.shared}" if suspect.shared else ""
    return f"would bring the poses of rows {rows}{shared}, {change}{saved}"


def alternatives(suspect: SuspectRecord) -> str:
    """What else would explain the same; empty where nothing would."""
    return f"could as well be {'; '.join(suspect.alternatives)}" if suspect.alternatives else ""


def deciding(number: int) -> str:
    """The command that chooses the poses which decide the suspect of that number."""
    return f"gpmodel poses --after RESULT --suspect {number}"
