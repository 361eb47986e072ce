"""Test that the pages of the experiments state the numbers of the results files."""

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.chapter5_outside import extrapolation
from experiments.chapter5_outside import run as outside
from experiments.hexapod import run as hexapod
from experiments.models import run as models

ROOT = Path(__file__).parents[2] / "experiments"
PAGE = (ROOT / "README.md").read_text(encoding="utf-8")
JOINT_PAGE = (ROOT / "spherical_joint" / "README.md").read_text(encoding="utf-8")
DESIGN_PAGE = (ROOT / "joint_design" / "README.md").read_text(encoding="utf-8")


@cache
def results(file: str) -> dict[str, Any]:
    return dict(json.loads((ROOT / file).read_text(encoding="utf-8")))


def section(page: str, head: str) -> str:
    return page.split(head)[1].split("\n#")[0]


def plain(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize(
    ("file", "head"),
    [("models/results.json", "### Fig 5.11"), ("models/harder.json", "### A harder arm")],
    ids=["thesis", "harder"],
)
def test_the_medians_of_the_models_are_those_of_the_file(file: str, head: str) -> None:
    text = section(PAGE, head)
    assert results(file)["command"] in text
    for step, (mean, largest, held, held_largest) in results(file)["median_mm"].items():
        assert f"| {step} | {mean:.2f} / {largest:.2f} | {held:.2f} / {held_largest:.2f} |" in text


def test_what_holds_on_how_many_robots_is_that_of_the_file() -> None:
    text = section(PAGE, "### Fig 5.11")
    for said, held in results("models/results.json")["conclusions"].items():
        assert f"| {said} | {held} |" in text or said.startswith("the loop names")
    harder, masses, fresh = (results(f"models/{name}.json") for name in ("harder", "harder_masses", "harder_fresh"))
    text = section(PAGE, "### A harder arm")
    for file, given in ((harder, "exact"), (masses, "wrong by up to 20 %"), (fresh, "wrong by up to 20 %")):
        assert f"| {given} | {file['all seven named and nothing else']} |" in text
    apart = [robot["seed"] for file in (harder, fresh) for robot in file["robots"] if robot["other"]]
    assert f"On robots {' and '.join(map(str, apart))} two eccentricities are named joint by joint" in plain(text)
    means = [robot["mm"]["the loop's own"][2] for robot in harder["robots"]]
    assert f"{min(means):.3f} to {max(means):.3f} mm on each" in plain(text)


TABLES = {
    "### Fig 5.7": ("fitness/results.json",),
    "### Fig 5.8": ("extrapolation/results.json",),
    "### Figs 5.9 and 5.12": ("histogram/results.json",),
    "### Fig 5.11": ("models/results.json",),
    "### A harder arm": ("models/harder.json", "models/harder_fresh.json"),
    "### Section 5.2.4": ("framework/results.json",),
    "### Figs 5.8 to 5.12 on": ("chapter5_outside/results.json",),
    "## Beyond the thesis: a machine": ("hexapod/results.json",),
}


CONCLUSIONS = [
    ("chapter5_outside/results.json", outside.conclusions, "robots", 20),
    ("chapter5_outside/extrapolation.json", extrapolation.conclusions, "robots", 20),
    ("hexapod/results.json", hexapod.conclusions, "machines", 8),
    ("models/results.json", models.conclusions, "robots", 10),
]


@pytest.mark.parametrize(("file", "conclude", "kind", "least"), CONCLUSIONS, ids=[case[0] for case in CONCLUSIONS])
def test_conclusions_are_those_of_the_machines_in_the_file_and_hold_on_nine_of_ten(
    file: str, conclude: Callable[[Any], dict[str, str]], kind: str, least: int
) -> None:
    content = results(file)
    assert conclude(content[kind]) == content["conclusions"]
    assert len(content[kind]) >= least
    for name, count in content["conclusions"].items():
        held, of = (int(word) for word in count.split(" of "))
        assert held >= 0.9 * of or (conclude is models.conclusions and not name.startswith("the loop")), name


def test_medians_are_those_of_the_machines_and_fall_from_model_to_model() -> None:
    medians = results("chapter5_outside/results.json")["median_heldout_mean_mm"]
    assert medians["loop"] < medians["hand-made"] < medians["standard"]
    machines = results("hexapod/results.json")
    assert hexapod.medians(machines["machines"]) == machines["median_heldout_rms_um"]


def numbers(content: object) -> list[float]:
    """Every number in the content of a file, the words of its texts included, and how many each list has."""
    if isinstance(content, dict):
        return [x for item in content.items() for part in item for x in numbers(part)]
    if isinstance(content, list):
        return [float(len(content)), *(x for part in content for x in numbers(part))]
    if isinstance(content, str):
        return [float(word) for word in re.findall(r"\d+\.?\d*", content)]
    return [float(content)] if isinstance(content, int | float) else []


@pytest.mark.parametrize("head", TABLES)
def test_every_number_of_a_table_is_in_the_file(head: str) -> None:
    """Numbers match as printed, in thousands or in millions."""
    known = np.abs(numbers([results(file) for file in TABLES[head]]))[:, None] * [1.0, 1e-3, 1e-6]
    rows = [line for line in section(PAGE, head).splitlines() if line.startswith("|")]
    cells = "\n".join(cell for row in rows for cell in row.split("|")[2:])
    missing = []
    for text in re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.])", cells):
        half = 0.51 * 10.0 ** -len(text.partition(".")[2])
        if not (np.abs(known - float(text)) <= half).any():
            missing.append(text)
    assert missing == []


ROWS = {"nothing": "nothing", "lobes": "12 µm cos 3J2", "sin2J1": "8 µm sin 2J1", "growth": "1.2 µm/K (t - 20)"}


@pytest.mark.parametrize("kind", ROWS)
def test_the_rigs_are_those_of_the_file(kind: str) -> None:
    told = results("spherical_joint/rigs.json")
    on, off = (told[ball]["found"][kind] for ball in ("ball on the yaw axis", "ball off the axis"))
    assert max(on["largest refit"], off["largest refit"]) < 1.005
    shipped = [sum(bool(rig["named"]) and rig["shipped"] for rig in rigs["rigs"]) for rigs in (on, off)]
    cells = [
        f"{rigs['right']} of {rigs['of']} | "
        + (f"{rigs['true name']} | {found} | {rigs['told']}" if kind != "nothing" else "- | - | -")
        for rigs, found in zip((on, off), shipped, strict=True)
    ]
    assert f"| {ROWS[kind]} | {cells[0]} | {cells[1]} |" in JOINT_PAGE


def test_the_lobes_that_are_named_on_the_rigs_are_those_of_the_file() -> None:
    """Eight findings on the axis say four lobes; off the axis eight say three."""
    told = results("spherical_joint/rigs.json")
    on, off = (
        [name for rig in told[ball]["found"]["lobes"]["rigs"] for name in rig["named"]]
        for ball in ("ball on the yaw axis", "ball off the axis")
    )
    assert "on the axis 8 of the 10 findings of lobes say four" in plain(JOINT_PAGE)
    assert (sum(" 4 lobes " in name for name in on), len(on)) == (8, 10)
    assert "three lobes are named on 8 of 10" in plain(JOINT_PAGE)
    assert sum(" 3 lobes " in name for name in off) == 8


def test_the_coverage_of_the_placement_is_that_of_the_file() -> None:
    for ball in ("ball on the yaw axis", "ball off the axis"):
        covered = results("spherical_joint/rigs.json")[ball]["coverage"]
        assert f"rigs {100 * covered['95 % of all']:.1f} % are within" in plain(JOINT_PAGE)
        assert all(0.93 <= share["1.96"] <= 0.985 for share in covered["within"].values())


def test_the_bad_balls_of_hexapods_are_those_of_the_file() -> None:
    told = results("twelve_balls/hexapod.json")
    rows = {
        "the bad ball is named, and nothing else": "the bad ball is named, and nothing else",
        "its lobes are named or among the rivals": "three lobes over the true angle are the finding or one of its "
        "alternatives",
        "told of them a fit passes": "told",
        "silent where all are good": "silent where all balls are round",
    }
    for key, said in rows.items():
        assert f"| {said} | {told[key]} |" in PAGE
    missed = [m["told_sigmas"] for m in told["machines"] if not m["right"]]
    assert missed == [min(m["told_sigmas"] for m in told["machines"])]
    assert f"stands out by {missed[0]} standard deviations" in plain(PAGE)
    assert told["command"].removeprefix("python -m ") in PAGE


def test_the_tau_robots_are_those_of_the_file() -> None:
    tau = results("twelve_balls/tau.json")
    keys = ("the bad ball is named, and nothing else", "told of them a fit passes", "silent where all are good")
    said = (keys[0], "told", "silent where all balls are round")
    rows = "\n".join(f"| {name} | {tau[key]} |" for name, key in zip(said, keys, strict=True))
    assert rows in section(PAGE, "## Beyond the thesis: one bad ball")


def test_what_table_1_2_asks_of_the_joint_is_that_of_the_file() -> None:
    limits = {x["quantity"]: x["there"] for x in results("joint_design/results.json")["whole_joint"]}
    stiffness, tilt = limits["stiffness that is asked for"], limits["tilt that is asked for"]
    assert f"[{tilt:.0f}°, {stiffness:.1f} N/µm](joint_design/README.md)" in PAGE
    assert f"film and magnets have {stiffness:.1f} together" in plain(DESIGN_PAGE)


def test_the_spherical_film_is_that_of_the_file() -> None:
    film = results("joint_design/results.json")["sphere_against_flat"]
    inlet, across = (film[f"sphere_{name}"] for name in (
        "inlet_at_50_um_without_clearance_atm", "stiffness_across_at_50_um_N_per_um",
    ))  # fmt: skip
    assert re.search(rf"no clearance at all still {inlet:.1f}\b", plain(DESIGN_PAGE))
    assert f"| the same across the axis | - | {across:.1f} N/µm |" in DESIGN_PAGE


def test_the_measured_ur10_is_that_of_the_file() -> None:
    page, told = (
        (ROOT / "ur10_measured" / "README.md").read_text(encoding="utf-8"),
        results("ur10_measured/results.json"),
    )
    keys = ("mean_mm", "median_mm", "p95_mm", "max_mm")
    rows = [[f"{row[key]:.3f}" for key in keys] for row in (*told["after_discovery"], *told["heldout"].values())]
    light = page.replace("**", "")
    assert all(f"| {' | '.join(row)} |" in light for row in rows)
    for block in told["blocks"]:
        means = (f"{block[name]['mean_mm']:.3f}" for name in ("standard", "found"))
        assert f"| {block['rows'][0]}-{block['rows'][1]} | {' | '.join(means)} |" in page
    assert f"**{told['series_d']['found in A, shapes frozen']['mean_mm']:.3f}** mm mean" in plain(page)
    before, after, more = (
        row["mean_mm"] for row in (told["after_discovery"][1], told["after_discovery"][-1], told["heldout"]["found"])
    )
    said = f"mean error {before:.3f} → **{after:.3f} mm**; the same effects fitted to 1500, {more:.3f} |"
    assert said in (ROOT.parent / "README.md").read_text(encoding="utf-8")
