"""List the robots of the bench: undeclared effects, random formulas, and robots without an effect.

Each robot takes a few seconds. `why` names the decision of the selection that the robot tests, or its kind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from experiments.blind.case import Case
from experiments.blind.case import effect as _e
from experiments.blind.cases import CASES


@dataclass(frozen=True)
class Robot:
    """name: unique. kind: effects, formula or none. case: of a blind robot; factors, index: of a formula.

    evolved: with genetic programming as shipped, else the catalogue, smooth terms and formulas alone.
    quick: in the short list for use after every change.
    """

    name: str
    kind: str
    seed: int
    why: str
    case: Case | None = None
    factors: int = 0
    index: int = 0
    evolved: bool = False
    quick: bool = False


_LINKS = Case(
    "two_links", "irb_like", 120, 0.04,
    (
        _e("base_compliance", 0.20), _e("compliance", 0.15, joint=5), _e("thermal_link", 0.12, joint=2),
        _e("thermal_link", 0.12, joint=3), _e("harmonic", 0.10, joint=1, per_turn=1),
    ),
    columns=("temperature",),
)  # fmt: skip
_SPRING = Case("hardening_two_move", "seven_axes", 120, 0.03, (_e("hardening", 0.25, joint=2),), moving=(2, 4))
_RIPPLES = replace(
    CASES["curves_ten"], name="few_poses_72", poses=72,
    effects=tuple(_e("harmonic", 0.10, joint=j, per_turn=n) for j, n in ((1, 1), (2, 2), (3, 1), (4, 2))),
)  # fmt: skip
_SIX = replace(CASES["six_800"], poses=700)

_EFFECTS: tuple[tuple[str | Case, int, str], ...] = (
    ("six_800", 30, "compliances for a tilt of the base and a harmonic"),
    ("six_800", 31, "compliances for a tilt of the base and a harmonic"),
    (_SIX, 61, "six effects, five of them named"),
    ("tracker_walk_seven", 61, "set-up steps beside a random walk of the instrument"),
    ("tracker_walk_seven", 62, "set-up steps beside a random walk of the instrument"),
    ("drift", 61, "one axis of a drift keeps the rest out"),
    ("gantry_sag", 61, "four harmonics of a guideway for a sag"),
    ("gantry_screws", 20, "a scale of the instrument for two screw pitches"),
    ("scara_straightness", 20, "a straightness that its tool hardly shows"),
    ("rail_straightness", 61, "two errors of one guideway, each given to a formula"),
    ("windup_3", 31, "compliance, curve and hardening for a windup"),
    ("windup_3", 10, "a bound at one side for a saturation at both"),
    ("lag_forearm", 60, "a lag of 40 min between two offered values"),
    ("lag_forearm", 61, "a lag of 40 min between two offered values"),
    (_RIPPLES, 30, "72 poses: harmonics left by the first selection"),
    ("eccentric_all_150", 32, "six weak eccentricities, of which two remained"),
    ("eccentric_all_kuka_150", 31, "six weak eccentricities, of which two remained"),
    ("seven_weak_150", 30, "springs of seven joints, one broad group for all"),
    (_LINKS, 30, "thermal growth of the arm for that of two links"),
    (_SPRING, 30, "a hardening spring where two joints move"),
    ("hardening_2", 32, "a false compliance for hardening"),
    ("dead_zone_2", 31, "a curve for a dead zone"),
    ("difference_2_3", 30, "a formula at one of two parallel axes"),
    ("product_2_4", 32, "a product of two joint angles"),
    ("bump_2", 10, "a narrow bump"),
    ("spring_2", 31, "an eccentricity for a spring"),
    ("massless_kuka", 32, "one joint too many without masses"),
    ("wrong_masses_ur", 61, "wrong masses of two links"),
    ("measured_torque_three", 30, "measured torques"),
    ("curves_ur", 30, "error curves of six joints, some with many harmonics"),
    ("five_150", 31, "five effects and outliers"),
    ("four_150", 30, "four effects"),
    ("move_lag_ripple", 30, "last move, lag and ripple"),
    ("friction_2", 61, "friction of a drive on a walk of the joints"),
    ("hysteresis_2", 31, "hysteresis"),
    ("lift_tilt", 61, "a scale of the range beside a tilting lift"),
    ("ripple_two", 30, "ripple of two motors at high rates"),
    ("azimuth_and_offset", 60, "two errors of the instrument"),
    ("tracker_drift", 31, "a drift of the instrument"),
    ("warm_up_row", 62, "two warm-ups for one"),
)
_FORMULAS: tuple[tuple[int, int, int, str], ...] = (
    (2, 2, 4, "a formula sharper than its curve"),
    (0, 1, 3, "a step of J5"),
    (0, 1, 0, "sinc of time, 51 poses"),
    (0, 1, 6, "exponential, 42 poses"),
    (0, 1, 8, "dead zone"),
    (2, 1, 4, "bump at the base"),
    (2, 1, 5, "logarithm"),
    (2, 1, 7, "exponential of a torque, 72 poses"),
    (2, 1, 8, "sinc at the base"),
    (2, 1, 9, "kink of the payload"),
    (0, 2, 0, "sum of two shapes at one site"),
    (0, 2, 1, "product"),
    (0, 2, 4, "product of J1 and time at one site"),
    (0, 2, 6, "product of roots and powers"),
    (0, 2, 8, "sum, 75 poses"),
    (2, 2, 0, "product, 44 poses"),
    (2, 2, 1, "sum of a dead zone and a quotient"),
    (2, 2, 5, "product at the base, 88 poses"),
    (2, 2, 6, "product with a dead zone"),
    (2, 2, 9, "sum, 103 poses"),
)
_NONE: tuple[tuple[str, int, str], ...] = (
    ("null_outliers", 30, "outliers"),
    ("null_columns", 30, "columns without influence"),
    ("null_four", 30, "few joints, 60 poses"),
    ("two_move", 30, "two joints move"),
    ("student", 60, "heavy tails"),
    ("repeats_jitter", 60, "repeats without a label"),
    ("clusters_seven", 62, "clusters"),
    ("narrow_ten", 60, "a narrow workspace"),
    ("plain_gantry", 60, "linear axes"),
    ("small_moves", 30, "a walk of the joints"),
)
_EVOLVED = {
    "law_2_2_4", "law_0_1_3", "law_0_2_6", "windup_3_10", "product_2_4_32", "null_outliers_30", "null_four_30",
    "student_60", "clusters_seven_62", "small_moves_30",
}  # fmt: skip
_QUICK = {
    "drift_61", "gantry_screws_20", "windup_3_31", "lag_forearm_61", "eccentric_all_150_32", "seven_weak_150_30",
    "two_links_30", "few_poses_72_30", "wrong_masses_ur_61", "law_0_1_8", "law_2_2_0", "null_columns_30",
}  # fmt: skip


def _robots() -> dict[str, Robot]:
    made = [
        *(_blind("effects", case, seed, why) for case, seed, why in _EFFECTS),
        *(Robot(f"law_{s}_{f}_{i}", "formula", s, why, factors=f, index=i) for s, f, i, why in _FORMULAS),
        *(_blind("none", case, seed, why) for case, seed, why in _NONE),
    ]
    return {r.name: replace(r, evolved=r.name in _EVOLVED, quick=r.name in _QUICK) for r in made}


def _blind(kind: str, case: str | Case, seed: int, why: str) -> Robot:
    case = case if isinstance(case, Case) else CASES[case]
    return Robot(f"{case.name}_{seed}", kind, seed, why, case)


ROBOTS = _robots()
