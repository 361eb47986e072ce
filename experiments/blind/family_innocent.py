"""Robots that have nothing, measured as it happens: repeats, clusters, heavy tails, few joints, little room."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case

_CLOCK = ("time", "room")

OPEN = [
    Case("plain_cobot", "cobot_ten", 150, 0.05),
    Case("repeats_labelled", "irb_like", 180, 0.015, repeats=3, labelled=True, shared_mm=0.04),
    Case("repeats_jitter", "ur_like", 180, 0.01, repeats=3, shared_mm=0.04),
    Case("clusters", "kuka_like", 120, 0.03, order="clusters", shared_mm=0.02),
    Case("student", "puma_like", 100, 0.04, noise="student"),
    Case("narrow", "staubli_like", 100, 0.03, narrow=0.15),
    Case("two_move", "irb_like", 90, 0.03, moving=(2, 3)),
    Case("small_moves", "ur_like", 150, 0.03, order="walk", columns=_CLOCK),
]
ASIDE = [
    Case("plain_rail", "rail_kuka", 150, 0.04, columns=("temperature", "humidity")),
    Case("repeats_labelled_puma", "puma_like", 180, 0.02, repeats=3, labelled=True, shared_mm=0.05),
    Case("repeats_jitter_kuka", "kuka_like", 180, 0.02, repeats=3, shared_mm=0.05),
    Case("clusters_seven", "seven_axes", 200, 0.03, order="clusters", shared_mm=0.03),
    Case("student_welder", "welder", 150, 0.05, noise="student", columns=("operator",)),
    Case("narrow_ten", "cobot_ten", 120, 0.03, narrow=0.2),
    Case("two_move_ur", "ur_like", 90, 0.03, moving=(1, 4)),
    Case("plain_gantry", "gantry", 120, 0.03, columns=_CLOCK),
]

CASES = [
    *(replace(case, family="innocent") for case in OPEN),
    *(replace(case, family="innocent", aside=True) for case in ASIDE),
]
