"""Write a Report as text of 80 columns, similar to lmfit's fit_report: first held-out errors, then effects."""

from collections.abc import Iterator

from gpmodel import wording
from gpmodel.report import verdict, words
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord
from gpmodel.wording import NAME, WIDTH, wrapped

MOST_LISTED = 12
"""Largest number of names in a list of the text report; further names are counted."""


def summary(report: Report) -> str:
    """Write verdict, errors by step, noise floor, effects with σ and causes, parameters and caveats as text."""
    blocks = (
        ("Verdict", [wrapped(" ".join(filter(None, (report.verdict, verdict.behind(report)))))]),
        ("3-D error, mm", list(_ladder(report))),
        ("Predictions", [wrapped(said)] if (said := words.predicted(report)) else []),
        ("Residual RMS of each kind of measurement, in its unit", list(_readings(report))),
        ("Noise floor", [wrapped(words.noise_floor(report))]),
        ("Instrument", [wrapped(words.instrument(report))] if report.instrument else []),
        ("Effects" if report.kind == "calibrate" else "Findings", list(_effects(report))),
        ("Rejected candidates", list(_rejected(report))),
        ("Significant inputs", list(_inputs(report))),
        ("Parameters, fitted to all poses", list(_parameters(report))),
        ("Tool in the flange, root in the instrument's frame", list(_placement(report))),
        ("Caveats", list(_doubts(report))),
    )
    return wording.titled(blocks)


def _ladder(report: Report) -> Iterator[str]:
    if not report.ladder:
        return
    sides = ("held out", "training") if report.held else ("training",)
    errors = [(r.heldout, r.train) if report.held else (r.train,) for r in report.ladder]
    rows = [[wording.millimetres(v) for e in row for v in (e.mean_mm, e.rms_mm, e.max_mm)] for row in errors]
    turns = [report.turn_mrad(rung) for rung in report.ladder]
    width = max(7, 2 + max(len(cell) for row in rows for cell in row))
    name = min(NAME, WIDTH - 4 - 10 - 8 * any(turns) - len(rows[0]) * width)
    yield " " * (name + 4) + "".join(f"{side:>{3 * width - 1}} " for side in sides).rstrip()
    heads = "".join(f"{head:>{width}}" for _ in sides for head in ("mean", "RMS", "max"))
    yield f"{' ' * (name + 4)}{heads}  unknowns{'    mrad' * any(turns)}"
    for rung, row, turn in zip(report.ladder, rows, turns, strict=True):
        title = report.title(rung)
        if len(title) > name:
            yield wrapped(title)
            title = ""
        cells = "".join(f"{cell:>{width}}" for cell in row)
        angle = "" if turn is None else f"{wording.significant(turn, 3):>8}"
        yield f"    {title:<{name}}{cells}{'' if rung.rank is None else rung.rank:>10}{angle}"


def _readings(report: Report) -> Iterator[str]:
    for kind in report.readings:
        change = " → ".join(wording.UNKNOWN if v is None else f"{v:.3g}" for v in (kind.before, kind.after))
        noise = "" if kind.noise is None else f", noise {kind.noise:.3g} {kind.unit}"
        yield f"    {kind.name:<{NAME}}{change} {kind.unit}{noise}, {kind.rows} rows"


def _effects(report: Report) -> Iterator[str]:
    if report.kind == "discover" and not report.effects:
        yield "    none: no further effect is significant"
    if said := words.confirmed(report):
        yield wrapped(said)
    for number, effect in enumerate(report.effects, 1):
        value = wording.measured(effect.value, effect.stderr, effect.unit)
        doubt = words.doubt(effect)
        if said := words.causes(effect) if doubt else "":
            yield wrapped(f"{number}  {words.title(effect)}; {said}")
            yield wrapped(f"{value}{_relative(effect)}, {doubt}", 7)
        else:
            yield wrapped(f"{number}  {effect.name}: {value}{_relative(effect)}")
        for basis, where in words.written(effect):
            yield wrapped(f"{basis} at {where}", 7)
        if said := "; ".join(words.constants(effect)):
            yield wrapped(said, 7)
        if effect.against:
            yield wrapped(effect.against, 7)
        if not effect.kept:
            yield wrapped("not identifiable with these poses, held at zero", 7)
        facts = [
            f"unique share {wording.percent(effect.unique_share)}" if effect.unique_share is not None else "",
            words.moves(effect),
            words.beside_specification(effect),
            f"chance {wording.chance(effect.p_value, effect.shuffles, effect.shuffled)}"
            if effect.p_value is not None
            else "",
        ]
        yield wrapped("; ".join(filter(None, facts)), 7)
        if not doubt and (said := words.causes(effect)):
            yield wrapped(said, 7)


def _rejected(report: Report) -> Iterator[str]:
    if report.rejected:
        yield wrapped(words.REJECTED)
    for number, candidate in enumerate(report.rejected, 1):
        yield wrapped(f"{number}  {candidate.name}: {words.lowers(candidate)}")
        yield wrapped(f"rejected: {candidate.why}", 7)
        yield wrapped(f"to select poses for a decision: {words.deciding(number)}", 7)


def _relative(effect: EffectRecord) -> str:
    if not effect.value or effect.stderr is None:
        return ""
    return f" ({100 * effect.stderr / abs(effect.value):.1f} %)"


def _inputs(report: Report) -> Iterator[str]:
    for number, histogram in enumerate(report.histograms, 1):
        standing = words.significant_inputs(histogram)
        yield wrapped(standing if len(report.histograms) == 1 else f"round {number}: {standing}")
    if said := words.removed(report):
        yield wrapped(said)


def _parameters(report: Report) -> Iterator[str]:
    if report.geometry():
        yield wrapped(words.interval(report))
    for parameter in report.geometry():
        value = wording.measured(parameter.value, parameter.stderr, parameter.unit, in_list=True)
        name = wording.short_name(parameter.name, NAME - 5)
        size = f"{value.value:>10} ± {value.deviation or wording.UNKNOWN:<7}{value.unit:<7}"
        share = f"share {wording.percent(parameter.unique_share)}"
        line = f"    {name:<{NAME - 4}}{size}{share:>12}"
        for near in parameter.correlated_with[:1]:
            beside = f"{near.name} {near.correlation:+.2f}"
            line += f"  {beside}" if len(line) + 2 + len(beside) <= WIDTH else f"\n      together with {beside}"
        yield line


def _placement(report: Report) -> Iterator[str]:
    for number in report.placement:
        value = wording.measured(number.value, number.stderr, number.unit, in_list=True)
        name = wording.short_name(number.name, NAME - 5)
        yield f"    {name:<{NAME - 4}}{value.value:>11} ± {value.deviation:<9}{value.unit}"


def _doubts(report: Report) -> Iterator[str]:
    if report.dropped():
        yield wrapped(words.dropped(report))
    if report.data.outliers:
        yield wrapped(f"{wording.left_out(report.data.outliers, report.data.poses)} of all fits and errors")
    if report.data.heldout and report.ladder and not report.held:
        yield wrapped(
            "no error on held-out poses is known: every held-out pose has a set-up or tool without training poses"
        )
    if report.unobservable:
        more = len(report.unobservable) - MOST_LISTED
        listed = ", ".join(report.unobservable[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
        yield wrapped(f"not determined, because joint values are solved at every pose and absorb the error: {listed}")
    yield from (wrapped(text) for text in (*report.unseen, *report.hidden))
    if report.status:
        limit = "" if report.condition_limit is None else f"; condition limit {report.condition_limit:g}"
        yield wrapped(f"{report.status}: {report.reason}{limit}")
