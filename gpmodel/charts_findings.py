"""Pictures of the search and of what it found: inputs beside their null, candidates, shapes, ranks, parameters."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from gpmodel.picture import (
    AFTER,
    AFTER_LIGHT,
    BEFORE,
    INK,
    MUTED,
    NULL,
    Array,
    Picture,
    Report,
    effect_name,
    log_axis,
    numbers,
    rows_only,
    shortened,
)
from gpmodel.wording import millimetres, minus, pretty_unit

MOST_INPUTS, MOST_PARAMETERS = 18, 36
KINDS = (("parameters_angles", "Angles", "rad", 1e6, "µrad"), ("parameters_lengths", "Lengths", "m", 1e6, "µm"))


def pictures(report: Report) -> Iterator[Picture]:
    """The pictures of the search and its findings that this report has numbers for."""
    for shape in (report.get("plots") or {}).get("shapes") or []:
        name = effect_name(report, int(shape["effect"]))
        x_name = f"{shape.get('x_name', 'row')}, {pretty_unit(shape.get('x_unit') or '1')}".rstrip(", ")
        if shape.get("x"):
            yield Picture(
                f"shape_{int(shape['effect']) + 1}", f"Shape of {name}", 4.9, 3.3,
                f"Partial residual of {name} over {x_name}, with the fitted curve where it depends on this input alone.",
                "Dots: what the data ask for, everything else in the model removed. Line: the fitted effect.",
                partial(_shape, shape=shape, x_name=x_name),
            )  # fmt: skip
    histograms = [h for h in report.get("histograms") or [report.get("histogram") or {}] if h.get("inputs")]
    for k, histogram in enumerate(histograms, 1):
        standing = ", ".join(histogram.get("significant") or []) or "none"
        shown = min(MOST_INPUTS, len(histogram["inputs"]))
        rest = "" if shown == len(histogram["inputs"]) else f" The {shown} most used of {len(histogram['inputs'])} inputs."
        yield Picture(
            f"inputs_{k}", f"Round {k}", 4.9, 1.1 + 0.21 * shown,
            f"Evolved programs that refer to each input, beside the same search on shuffled residuals; "
            f"inputs that stand out of chance: {standing}.",
            f"Stand out of chance: {standing}.{rest}",
            partial(_inputs, histogram=histogram),
        )  # fmt: skip
    rounds = [r for r in report.get("rounds") or [] if r.get("candidates")]
    if rounds:
        yield Picture(
            "search", "The best candidates of each round against chance", 10.2, 0.9 + 0.62 * len(rounds),
            f"Description length saved by the candidates of {len(rounds)} rounds, beside the best that shuffled "
            f"residuals gave; accepted: {sum(any(c.get('accepted') for c in r['candidates']) for r in rounds)}.",
            "Each dot is a distinct candidate. Chance: the best of each search on shuffled residuals.",
            partial(_search, rounds=rounds),
        )  # fmt: skip
    curve = [c for c in report.get("rank_curve") or [] if c.get("cv_rms_mm") is not None]
    if len(curve) > 1:
        best = min(curve, key=lambda c: c["cv_rms_mm"])
        yield Picture(
            "rank_curve", "Error against rank", 4.9, 3.3,
            f"Cross-validated error over the condition limit; lowest {millimetres(best['cv_rms_mm'])} mm with "
            f"{best['rank']} unknowns at a limit of {best['condition_limit']:g}.",
            "How many unknowns these poses support; the number beside a dot is the rank kept there.",
            partial(_rank, curve=curve, chosen=report.get("condition_limit")),
        )  # fmt: skip
    for name, title, unit, scale, shown_unit in KINDS:
        chosen = [p for p in report.get("parameters") or [] if _drawable(p, unit)]
        strongest = sorted(chosen, key=lambda p: -abs(p["value"]) / p["stderr"])[:MOST_PARAMETERS]
        rest = "" if len(strongest) == len(chosen) else f" The {len(strongest)} most certain of {len(chosen)}."
        if chosen:
            chosen = [p for p in chosen if any(p is s for s in strongest)]
            yield Picture(
                name, title, 4.9, 0.75 + 0.175 * len(chosen),
                f"{title} of the model with one standard deviation, {len(chosen)} parameters; values in the table below.",
                f"Value ± σ. Hollow: within 2 σ of zero.{rest}",
                partial(_parameters, parameters=chosen, scale=scale, unit=shown_unit),
            )  # fmt: skip


def _drawable(parameter: Mapping[str, Any], unit: str) -> bool:
    known = parameter.get("value") is not None and parameter.get("stderr")
    return bool(known) and parameter.get("unit") == unit and parameter.get("kept", True)


def _shape(figure: Any, shape: Mapping[str, Any], x_name: str) -> None:
    axes = figure.subplots()
    x, y = numbers(shape["x"]), numbers(shape["partial"])
    held = np.array(shape.get("heldout") or np.zeros(len(x)), dtype=bool)
    size = float(np.clip(1800 / len(x), 3, 18))
    axes.axhline(0, color="#b9c0c9", lw=0.8)
    axes.scatter(x[~held], y[~held], s=size, fc="white", ec=BEFORE, lw=1.0, label="train")
    if held.any():
        axes.scatter(x[held], y[held], s=size, color="#5d6875", lw=0, label="held out", zorder=3)
    curve_x, curve_y = numbers(shape.get("curve_x")), numbers(shape.get("curve_y"))
    if len(curve_x):
        axes.plot(curve_x, curve_y, color=AFTER, lw=2.4, label="fitted", zorder=4)
    axes.set(xlabel=x_name, ylabel=f"partial residual, {shape.get('y_unit', '')}".rstrip(", "))
    for which in (axes.xaxis, axes.yaxis):
        which.set_major_formatter(lambda v, _: minus(f"{v:g}"))
    axes.grid(axis="both")
    figure.legend(loc="outside upper right", ncols=3, labelcolor=MUTED, handletextpad=0.4)


def _inputs(figure: Any, histogram: Mapping[str, Any]) -> None:
    axes = figure.subplots()
    names = list(histogram["inputs"])
    linear, tree, null = (_padded(histogram.get(k), len(names)) for k in ("linear", "tree", "shuffled"))
    chances = _padded(histogram.get("p_values"), len(names))
    use = linear + tree
    order = np.sort(np.argsort(-np.maximum(use, null), kind="stable")[:MOST_INPUTS])
    axes.set_ylim(len(order) - 0.4, -0.6)
    strong = set(histogram.get("significant") or [])
    for row, k in enumerate(order):
        dark, light = (AFTER, AFTER_LIGHT) if names[k] in strong else ("#a3abb5", "#ccd2d9")
        axes.barh(row - 0.18, linear[k], 0.36, color=dark)
        axes.barh(row - 0.18, tree[k], 0.36, left=linear[k], color=light)
        axes.barh(row + 0.2, null[k], 0.26, color=NULL)
        if names[k] in strong and chances[k] > 0:
            axes.annotate(f"p {chances[k]:.2g}", (use[k], row - 0.18), (4, 0), textcoords="offset points", va="center",
                          color=AFTER, fontsize=8.5, weight="bold")  # fmt: skip
    axes.set_yticks(range(len(order)), [names[k] for k in order])
    for label, k in zip(axes.get_yticklabels(), order, strict=True):
        if names[k] in strong:
            label.set(color=AFTER, weight="bold")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlim(0, 1.18 * max(use.max(), null.max(), 1))
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("best programs that refer to the input")
    axes.grid(axis="x")
    for colour, label in (("#7d8896", "linear (dark), tree (light)"), (NULL, "on shuffled residuals")):
        axes.barh(0, 0, color=colour, label=label)
    figure.legend(loc="outside upper right", ncols=2, labelcolor=MUTED)


def _padded(values: Any, length: int) -> Array:
    out = np.zeros(length)
    given = np.nan_to_num(numbers(values))[:length]
    out[: len(given)] = given
    return out


def _search(figure: Any, rounds: list[Mapping[str, Any]]) -> None:
    axes = figure.subplots()
    key, null_key = ("nats", "null_nats") if "nats" in rounds[0]["candidates"][0] else ("gain", "null_gain")
    rows_only(axes, len(rounds), 0.6)
    for row, entry in enumerate(rounds):
        null = numbers(entry.get(null_key))
        axes.scatter(null, np.full(len(null), row + 0.17), s=16, marker="|", color=NULL, lw=1.2)
        for candidate in entry["candidates"]:
            value = candidate.get(key)
            if value is None:
                continue
            won = bool(candidate.get("accepted"))
            axes.scatter(value, row - 0.08, s=70 if won else 26, color=AFTER if won else BEFORE, lw=0, zorder=4 if won else 3)
            if won:
                axes.annotate(shortened(str(candidate.get("name")), 60), (value, row - 0.08), (-8, 0), va="center",
                              textcoords="offset points", ha="right", color=AFTER, weight="bold")  # fmt: skip
        if not any(c.get("accepted") for c in entry["candidates"]):
            axes.text(1.0, row - 0.08, "nothing stands out: nothing added", ha="right", va="center", color=MUTED,
                      transform=axes.get_yaxis_transform())  # fmt: skip
    axes.set_yticks(range(len(rounds)), [f"round {r.get('round', k + 1)}" for k, r in enumerate(rounds)])
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.axvline(0, color="#b9c0c9", lw=0.8)
    axes.xaxis.set_major_formatter(lambda v, _: minus(f"{v:g}"))
    axes.set_xlabel("description length saved, nats" if key == "nats" else "share of the residual energy removed")
    for colour, label, mark in ((AFTER, "added", "o"), (BEFORE, "rejected", "o"), (NULL, "chance", "|")):
        axes.scatter([], [], color=colour, marker=mark, s=30, label=label)
    figure.legend(loc="outside upper right", ncols=3, labelcolor=MUTED, handletextpad=0.3)


def _rank(figure: Any, curve: list[Mapping[str, Any]], chosen: float | None) -> None:
    axes = figure.subplots()
    limit, rank, error = (numbers([c[k] for c in curve]) for k in ("condition_limit", "rank", "cv_rms_mm"))
    log_axis(axes, 0.6 * limit.min(), 1.8 * limit.max())
    if error.max() > 5 * error.min() > 0:
        log_axis(axes, 0.8 * error.min(), 1.4 * error.max(), "y")
    else:
        axes.set_ylim(min(0.0, error.min()), 1.2 * error.max())
    best = int(np.argmin(np.abs(np.log(limit / chosen)))) if chosen else int(np.argmin(error))
    axes.plot(limit, error, "o-", color=BEFORE, lw=1.4, ms=4.5)
    axes.plot(limit[best], error[best], "o", color=AFTER, ms=8.5)
    last = None
    for k in range(len(curve)):
        if rank[k] != last or k == best:
            here = k == best
            axes.annotate(f"{rank[k]:.0f}{' unknowns' if here else ''}", (limit[k], error[k]), (0, 8),
                          textcoords="offset points", ha="center", va="bottom", fontsize=8.5,
                          color=AFTER if here else MUTED, weight="bold" if here else "normal")  # fmt: skip
        last = rank[k]
    axes.set(xlabel="condition limit", ylabel="cross-validated RMS, mm")
    axes.grid(axis="both")


def _parameters(figure: Any, parameters: list[Mapping[str, Any]], scale: float, unit: str) -> None:
    axes = figure.subplots()
    value = scale * numbers([p["value"] for p in parameters])
    deviation = scale * numbers([p["stderr"] for p in parameters])
    axes.set_ylim(len(parameters) - 0.4, -0.6)
    axes.axvline(0, color="#b9c0c9", lw=1)
    for row, (v, s) in enumerate(zip(value, deviation, strict=True)):
        clear = abs(v) > 2 * s
        colour = AFTER if clear else BEFORE
        axes.plot([v - s, v + s], [row, row], color=colour, lw=1.6)
        axes.plot(v, row, "o", mfc=colour if clear else "white", mec=colour, ms=4.5)
    axes.set_yticks(range(len(parameters)), [shortened(str(p["name"]), 30) for p in parameters])
    axes.tick_params(axis="y", length=0, labelsize=8)
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_formatter(lambda v, _: minus(f"{v:g}"))
    axes.set_xlabel(unit)
    axes.grid(axis="x")
