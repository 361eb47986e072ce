"""Compare Tables 3.1, 4.1 and 4.2 of the thesis by cells, and the flat with the spherical air film.

From the root of the repository: python -m experiments.joint_design.run
"""

import json
import time
import tomllib
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from gpmodel.files import plain
from gpmodel.report.origin import versions
from joints.film import design_film, film_geometry, orifice_law
from joints.orifice import ATMOSPHERE
from joints.reynolds import lateral_stiffness, spherical_film
from joints.settings import load_settings
from joints.studies import STUDIES

HERE = Path(__file__).parent


def compare(table: dict[str, Any], computed: list[dict[str, float]]) -> dict[str, Any]:
    """Cells of a printed table that the computed rows give to the printed digit, and those they do not."""
    differences = [
        {"row": row[0], "column": name, "printed": printed, "computed": ours[name]}
        for row, ours in zip(table["rows"], computed, strict=True)
        for name, digits, printed in zip(table["columns"], table["digits"], row, strict=True)
        if round(ours[name], digits) != printed
    ]
    cells = len(table["rows"]) * len(table["columns"])
    return {"cells": cells, "matching": cells - len(differences), "differences": differences, "computed": computed}


def sphere_against_flat() -> dict[str, float]:
    """At the inlet pressure that lifts the flat film's ball by 50 um: where the spherical film puts it."""
    settings = load_settings("film")
    geometry, orifice = film_geometry(settings), orifice_law(settings["orifice"])
    flat = design_film(geometry, settings["preload"], orifice, 50e-6)

    def excess(lift: float) -> float:
        return float(spherical_film(geometry, settings["preload"], orifice, lift).inlet_pressure - flat.inlet_pressure)

    lift = brentq(excess, 10e-6, 60e-6)
    film = spherical_film(geometry, settings["preload"], orifice, lift)
    same = spherical_film(geometry, settings["preload"], orifice, 50e-6)
    tight = spherical_film(replace(geometry, clearance=1e-9), settings["preload"], orifice, 50e-6)
    return {
        "inlet_atm": float(flat.inlet_pressure) / ATMOSPHERE,
        "flat_stiffness_N_per_um": float(flat.stiffness_constant_inlet) * 1e-6,
        "sphere_lift_um": lift * 1e6,
        "sphere_stiffness_N_per_um": float(film.stiffness_constant_inlet) * 1e-6,
        "sphere_over_flat_flow_at_50_um": float(same.flow / flat.flow),
        "sphere_inlet_at_50_um_atm": float(same.inlet_pressure) / ATMOSPHERE,
        "sphere_inlet_at_50_um_without_clearance_atm": float(tight.inlet_pressure) / ATMOSPHERE,
        "sphere_stiffness_at_50_um_N_per_um": float(same.stiffness_constant_inlet) * 1e-6,
        "sphere_stiffness_across_at_50_um_N_per_um": float(lateral_stiffness(geometry, same, orifice)) * 1e-6,
    }


def main(out: Path = HERE) -> None:
    published = tomllib.loads((HERE / "published.toml").read_text(encoding="utf-8"))
    studies = {name: study(None, 0) for name, study in STUDIES.items()}
    data = plain({name: study.data for name, study in studies.items()})
    preload = data["preload"]
    order = {(row[0], row[2]): place for place, row in enumerate(published["table_3_1"]["rows"])}
    designs = sorted(preload["designs"], key=lambda d: order[round(d["socket_angle_deg"]), round(d["ring_angle_deg"])])
    flat = data["film"]["flat_plate"]
    guide = [{name: flat[name][i] for name in flat} for i in range(len(flat["gap_um"]))]
    figures = []
    for figure in published["figure"]:
        computed = reduce(lambda table, key: table[key], figure["key"].split("."), data)
        matches = round(computed, figure["digits"]) == figure["printed"]
        figures.append({**figure, "computed": computed, "matches": matches})
    results = {
        "command": "python -m experiments.joint_design.run",
        "versions": versions(),
        "table_3_1_and_4_1": compare(published["table_3_1"], designs),
        "best_of_any_angle": preload["continuous_optimum"][0],
        "table_4_2": compare(published["table_4_2"], guide),
        "figures": figures,
        "sphere_against_flat": sphere_against_flat(),
        "stiffness": data["stiffness"]["predicted"],
        "pugh": data["pugh"]["charts"],
        "whole_joint": data["design"]["limits"],
    }
    (out / "figures").mkdir(exist_ok=True)
    (out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    drawn = {
        file: figure
        for name in studies
        if name not in ("pugh", "design")
        for file, figure in studies[name].figures.items()
    }
    for file, figure in drawn.items():
        figure.savefig(out / "figures" / file, dpi=90, metadata={"Software": None})
    for name in ("table_3_1_and_4_1", "table_4_2"):
        print(name, results[name]["matching"], "of", results[name]["cells"], results[name]["differences"])
    print("figures", sum(figure["matches"] for figure in figures), "of", len(figures), results["sphere_against_flat"])
    settings, lift = load_settings("film"), np.random.default_rng(0).uniform(20e-6, 60e-6, 1_000_000)
    for film in (design_film, spherical_film):
        start = time.perf_counter()
        film(film_geometry(settings), settings["preload"], orifice_law(settings["orifice"]), lift)
        print(f"a million films: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
