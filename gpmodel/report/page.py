"""report.html: one page that opens offline, a pure function of the saved report."""

import base64
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from gpmodel import wording
from gpmodel.files import write_text
from gpmodel.report import charts_errors, charts_findings, charts_search, charts_space, schema
from gpmodel.report.picture import Report, beyond_standard, step_title
from gpmodel.report.saved import as_dict

PAGE = "report.html"


def write_page(report: schema.Report, folder: Path, figures: Mapping[str, Path] | None = None) -> Path:
    """Write `report.html` in `folder` with the figures inside it; drawn there first where none are given."""
    if figures is None:
        from gpmodel.report.figures import write_figures

        figures = write_figures(report, folder)
    path = folder / PAGE
    write_text(path, html(report, figures))
    return path


def html(saved: schema.Report, figures: Mapping[str, Path]) -> str:
    """The page's text; a report with parts missing gives a page without them."""
    report = as_dict(saved)
    data, ladder = dict(report.get("data") or {}), list(report.get("ladder") or [])
    return _template().render(
        report=report,
        data=data,
        mechanism=report.get("mechanism") or {},
        verdict=str(report.get("verdict") or "No verdict was saved."),
        tiles=_tiles(report, ladder),
        ladder=[_rung(report, rung) for rung in ladder],
        held=any(_side(r, "heldout") for r in ladder),
        effects=[_effect(e, i) for i, e in enumerate(report.get("effects") or [], 1)],
        rounds=[_round(r, k) for k, r in enumerate(report.get("rounds") or [], 1)],
        parameters=[_parameter(p) for p in report.get("parameters") or [] if p.get("kept", True)],
        dropped=_dropped(report, ladder),
        outliers=list(data.get("outliers") or []),
        pictures=_pictures(report, figures),
    )


@cache
def _template() -> Any:
    loader = PackageLoader("gpmodel.report")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(millimetres=wording.millimetres, percent=wording.percent)
    return environment.get_template("report.html.j2")


def _pictures(report: Report, figures: Mapping[str, Path]) -> dict[str, dict[str, Any]]:
    out: dict[str, dict[str, Any]] = {}
    for chart in (charts_errors, charts_space, charts_search, charts_findings):
        for picture in chart.pictures(report):
            if picture.name in figures:
                image = base64.b64encode(figures[picture.name].read_bytes()).decode()
                out[picture.name] = {
                    "source": f"data:image/png;base64,{image}",
                    "title": picture.title,
                    "alt": picture.alt,
                    "caption": picture.caption,
                    "width": round(96 * picture.width),
                    "height": round(96 * picture.height),
                }
    return out


def _side(rung: Mapping[str, Any], side: str) -> dict[str, Any]:
    """mean, RMS and maximum in mm; empty where there is none."""
    numbers = rung.get(side) or {}
    return dict(numbers) if numbers.get("rms_mm") is not None else {}


def _rung(report: Report, rung: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "title": step_title(report, rung),
        "sides": [[_side(rung, side).get(f"{k}_mm") for k in ("mean", "rms", "max")] for side in ("heldout", "train")],
        "rank": rung.get("rank"),
        "found": beyond_standard(rung),
    }


def _tiles(report: Report, ladder: list[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The numbers to remember: RMS on held-out poses after the steps that matter, and the noise floor."""
    by_step = {str(r["step"]): r for r in ladder}
    chosen = [
        ("registration and tool", by_step.get("registration"), "start"),
        ("standard model", by_step.get("standard"), "before"),
    ]
    count = sum(r.get("effect") is not None for r in ladder)
    if ladder and beyond_standard(ladder[-1]):
        title = f"with {count} effect{'s' if count != 1 else ''} found" if count else step_title(report, ladder[-1])
        chosen.append((title, ladder[-1], "after"))
    elif chosen[1][1] is not None:
        chosen[1] = ("standard model", chosen[1][1], "after")
    tiles = []
    for title, rung, kind in chosen:
        if rung is not None:
            side = _side(rung, "heldout") or _side(rung, "train")
            where = "RMS held out" if _side(rung, "heldout") else "RMS training"
            tiles.append(
                {"title": title, "value": wording.millimetres(side.get("rms_mm")), "note": where, "kind": kind}
            )
    floor = report.get("noise_floor_mm")
    if floor is not None:
        tiles.append(
            {
                "title": "noise floor",
                "value": wording.millimetres(floor),
                "note": "of the measurement itself",
                "kind": "floor",
            }
        )
    return tiles


def _partners(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(c["name"], wording.minus(f"{c['correlation']:+.2f}")) for c in entry["correlated_with"]]


def _effect(effect: Mapping[str, Any], number: int) -> dict[str, Any]:
    share = effect.get("unique_share")
    rivals = [r for r in effect.get("rivals") or [] if r.get("cv_rms_mm") is not None]
    checks = [
        ("removes of the residual energy", wording.percent(effect.get("gain")), effect.get("gain")),
        ("chance among shuffled residuals", wording.chance(effect.get("p_value")), effect.get("p_value")),
        ("sign in every fold", "the same" if effect.get("sign_stable") else "changes", effect.get("sign_stable")),
        (
            "cross-validated RMS before",
            f"{wording.millimetres(effect.get('cv_before_mm'))} mm",
            effect.get("cv_before_mm"),
        ),
        ("cross-validated RMS with it", f"{wording.millimetres(effect.get('cv_rms_mm'))} mm", effect.get("cv_rms_mm")),
    ]
    return {
        "number": number,
        "name": str(effect.get("name") or f"effect {number}"),
        "explanation": str(effect.get("explanation") or ""),
        "value": wording.measured(effect.get("value"), effect.get("stderr"), str(effect.get("unit") or "1")),
        "basis": wording.expression(str(effect.get("basis") or wording.UNKNOWN)),
        "place": " ".join(str(effect[k]) for k in ("slot", "axis") if effect.get(k)) or wording.UNKNOWN,
        "inputs": [str(x) for x in effect.get("inputs") or []],
        "share": share,
        "meter": None if share is None else max(0.0, min(1.0, float(share))),
        "found_by": str(effect.get("found_by") or ""),
        "catalogue": str(effect.get("catalogue") or "").replace("_", " "),
        "round": effect.get("round"),
        "checks": [(label, text) for label, text, given in checks if given is not None],
        "own": effect.get("cv_rms_mm"),
        "alone": effect["rivals"] == (),
        "rivals": [{"name": str(r.get("name")), "cv_rms_mm": r["cv_rms_mm"]} for r in rivals],
        "partners": _partners(effect),
        "picture": f"shape_{number}",
    }


def _round(entry: Mapping[str, Any], number: int) -> dict[str, Any]:
    candidates = []
    for c in entry.get("candidates") or []:
        candidates.append(
            {
                "name": str(c.get("name") or wording.UNKNOWN),
                "place": " ".join(str(c[k]) for k in ("slot", "axis") if c.get(k)) or wording.UNKNOWN,
                "basis": wording.expression(str(c.get("basis") or wording.UNKNOWN)),
                "found_by": str(c.get("found_by") or wording.UNKNOWN),
                "gain": wording.percent(c.get("gain")),
                "cv_rms_mm": c.get("cv_rms_mm"),
                "chance": wording.chance(c.get("p_value")),
                "accepted": bool(c.get("accepted")),
                "why": str(c.get("why") or ""),
            }
        )
    return {
        "number": entry.get("round", number),
        "candidates": candidates,
        "added": [c["name"] for c in candidates if c["accepted"]],
        "removed": [str(n) for n in entry.get("dropped") or []],
    }


def _parameter(parameter: Mapping[str, Any]) -> dict[str, Any]:
    value = wording.measured(parameter.get("value"), parameter.get("stderr"), str(parameter.get("unit") or "1"))
    return {
        "name": str(parameter.get("name")),
        "value": value,
        "share": parameter.get("unique_share"),
        "partners": _partners(parameter),
    }


def _dropped(report: Report, ladder: list[Mapping[str, Any]]) -> list[str]:
    """What these poses cannot tell apart and the model therefore leaves out."""
    listed = [str(p["name"]) for p in report.get("parameters") or [] if not p.get("kept", True)]
    return listed or [str(n) for n in (ladder[-1].get("dropped") if ladder else None) or []]
